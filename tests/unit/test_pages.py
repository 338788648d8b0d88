"""README and docs: links lead somewhere, scenes are scenes, commands and programs are read by their parsers."""

from __future__ import annotations

import ast
import json
import re
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
import typer.main
from markupsafe import Markup

from stickslip.workflows.commands.cli import app
from stickslip.workflows.formats import templates
from stickslip.workflows.formats.files import read_json
from stickslip.workflows.formats.templates import render
from stickslip.workflows.lab.pages import gallery
from stickslip.workflows.lab.pages.console import agree, blocks, commands, file_name, played, same
from stickslip.workflows.scene_file.read import READY, from_dict

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "workflows/SCENE.md", ROOT / "solvers/SOURCES.md"]
PAGES += sorted((ROOT / "docs").rglob("*.md"))
NOTEBOOKS = sorted((ROOT / "docs").rglob("*.ipynb"))  # executed by `make docs`
NAMES = [page.relative_to(ROOT).as_posix() for page in PAGES]
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
INCLUDE = re.compile(r"^```\{include\} (\S+)$", re.MULTILINE)
COMMAND = re.compile(r"^(?:\.venv/bin/|venv/bin/)?stickslip$")


@cache
def text_of(page: Path) -> str:
    """A page with what it includes."""
    text = page.read_text(encoding="utf-8")
    return INCLUDE.sub(lambda found: (page.parent / found[1]).read_text(encoding="utf-8"), text)


@cache
def anchors(page: Path) -> set[str]:
    """Of its headings, as GitHub and MyST make them."""
    outside = re.sub(r"^```.*?^```$", "", text_of(page), flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.+)$", outside, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    outside = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for target in LINK.findall(outside) + INCLUDE.findall(page.read_text(encoding="utf-8")):
        if re.match(r"https?:", target):
            continue
        name, _, anchor = target.partition("#")
        there = (page.parent / name).resolve() if name else page
        assert there.exists(), f"{page}: no file {target}"
        assert not anchor or anchor in anchors(there), f"{page}: no heading {target}"


def test_every_page_is_in_the_list_of_contents() -> None:
    listed = set(re.findall(r"^[\w/]+$", "\n".join(b[3] for b in toctrees(ROOT / "docs/index.md")), re.MULTILINE))
    listed |= {f"gallery/{n}" for b in toctrees(ROOT / "docs/gallery/index.md") for n in b[3].split("\n") if n}
    found = [*(ROOT / "docs").rglob("*.md"), *NOTEBOOKS]
    pages = {page.relative_to(ROOT / "docs").with_suffix("").as_posix() for page in found}
    assert pages - {"index"} == {name for name in listed if not name.startswith("gallery/:")}


def toctrees(page: Path) -> list[re.Match[str]]:
    return list(re.finditer(r"^```(\{)(toctree)\}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S))


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_every_block_is_what_it_says(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A block of TOML is a scene, or named a fragment; Python compiles."""
    monkeypatch.chdir(tmp_path)
    for table in READY.glob("*.[cg][se][vo]"):  # beside the ready scenes
        Path(table.name).symlink_to(table)
    for block in blocks(page.read_text(encoding="utf-8")):
        language, info, content = block.groups()
        Path(file_name(content) or "nameless").write_text(content, encoding="utf-8")
        if language == "toml":
            content = tomllib.loads(content)
            if info.strip() != "fragment":
                if not Path(content["geometry"].get("file", "")).exists():  # a program above it writes it
                    subprocess.run([sys.executable, *Path().glob("*.py")], check=True, stdout=subprocess.DEVNULL)
                from_dict(content)
        if language == "python" and page.stem not in ("architecture", "the_method"):  # excerpts, with their own tests
            ast.parse(content)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_compiles_links_and_is_stored_without_outputs(notebook: Path) -> None:
    cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
    for cell in cells:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            ast.parse(source)
            assert (cell["outputs"], cell["execution_count"]) == ([], None)
        for target in LINK.findall(source) if cell["cell_type"] == "markdown" else ():
            assert (notebook.parent / target).exists(), target


def command_lines(text: str) -> list[str]:
    """All shell lines of a page, in console blocks and indented."""
    found = [c.line for b in blocks(text) if b[1] == "console" for c in commands(b[3])]
    outside = re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE).replace("\\\n", " ")
    found += re.findall(r"^    (.*\bstickslip .*)$", outside, re.MULTILINE)
    return [line.replace("\\\n", " ") for line in found]


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_the_command_line_takes_every_command(page: Path) -> None:
    for line in command_lines(page.read_text(encoding="utf-8")):
        for words in simple_commands(line):
            first = next((k for k, word in enumerate(words) if COMMAND.match(word)), None)
            if first is not None and set(words[:first]) <= {"mpirun", "-n", "4"}:
                parsed(words[first + 1 :])


def simple_commands(line: str) -> list[list[str]]:
    """A line of the shell, cut at its operators; what follows a redirection counts no more."""
    found: list[list[str]] = [[]]
    words = shlex.shlex(line, posix=True, punctuation_chars=True)
    words.whitespace_split = True
    for word in words:
        if set(word) <= set("|&;<>"):
            found.append([])
        elif word != "2":  # of 2>
            found[-1].append(word)
    return found


def parsed(words: list[str]) -> None:
    """Raises if the command line has no such command, option or argument; `--help` ends it."""
    group = typer.main.get_command(app)
    if "--help" in words or words == ["--version"]:
        return
    command = group.commands[words[0]]
    command.make_context(words[0], words[1:])


def test_the_list_of_the_gallery_is_that_of_its_pages() -> None:
    """Renew it with `python -m stickslip.workflows.lab.pages.gallery`."""
    found = {path.stem: gallery.known(path.stem) for path in sorted(READY.glob("*.toml"))}
    assert (ROOT / "docs/gallery/index.md").read_text(encoding="utf-8") == gallery.contents(found)


def test_a_page_of_the_gallery_shows_the_last_step_of_its_contact() -> None:
    fact, number = gallery.known("block"), {"total": 0.1, "converges": True}
    state = dict.fromkeys(gallery.NUMBERS, 2.0) | {"error": dict.fromkeys(gallery.NUMBERS, number)}
    text = gallery.page("block", fact, {"steps": [{"contacts": {fact["main"].split(".")[0]: state}}]})
    shown = (ROOT / "docs/gallery/block.md").read_text(encoding="utf-8")
    head, mark, rest = text.partition("| number [SI] | value |\n|---|---|\n")
    assert shown.startswith(head + mark)
    assert shown.endswith(rest[rest.index("\n\n") :])
    assert rest.startswith("| normal force | 2.0 ± 0.1 |\n")


@pytest.mark.parametrize("scene", sorted(READY.glob("*.toml")), ids=lambda path: path.stem)
def test_the_gallery_shows_the_scene_as_it_is(scene: Path) -> None:
    """Renew it with `python -m stickslip.workflows.lab.pages.gallery`."""
    page = (ROOT / "docs/gallery" / f"{scene.stem}.md").read_text(encoding="utf-8")
    (shown,) = (block[3] for block in blocks(page) if block[1] == "toml")
    assert shown == scene.read_text(encoding="utf-8")
    assert all((ROOT / "docs/gallery" / f"{scene.stem}{ending}.png").exists() for ending in ("", "_contact"))


def test_a_wrong_option_is_noticed() -> None:
    with pytest.raises(Exception, match=r"No such option.*--mash"):
        parsed(["plan", "block", "--mash"])


def test_a_page_is_a_program(tmp_path: Path) -> None:
    page = "```python\n# add.py\nprint('sum', 1 + 0.25, 'after 3 s')\n```\n```console\n$ python3 add.py\n{}\n```\n"
    assert played(page.format("sum 1.3 after 7 s"), tmp_path) == (page.format("sum 1.3 after 7 s"), [])
    new, complaints = played(page.format("sum 1.4 after 7 s"), tmp_path)
    assert new == page.format("sum 1.25 after 3 s")
    assert len(complaints) == 1
    kept, complaints = played(page.format("...\nof nothing"), tmp_path)
    assert kept == page.format("...\nof nothing")
    assert len(complaints) == 1
    with pytest.raises(ValueError, match="exit code 3"):
        played("```console\n$ exit 3\n```\n", tmp_path)


@pytest.mark.slow  # five processes and some twenty runs
def test_the_tutorial_of_calibration_finds_what_its_bench_has_hidden(tmp_path: Path) -> None:
    """On fewer cells and steps than it shows: its commands run, and end as they say."""
    text = (ROOT / "docs/tutorials/calibration.md").read_text(encoding="utf-8")
    played(text.replace("mesh_size = 2.5e-3", "mesh_size = 5e-3").replace("count = 20", "count = 10"), tmp_path)
    known = dict(zip(("friction.mu", "friction.k_T", "normal.c_n"), (0.42, 2e13, 5e13), strict=True))
    force, guess, fitted = (read_json(tmp_path / name / "fit.json") for name in ("force", "guess", "fitted"))
    for key, value in known.items():
        name = f"contacts.base.{key}"
        assert abs(fitted["values"][name] - value) < 3 * fitted["deviations"][name] < 0.1 * value
    assert guess["not_told"] == ["contacts.base.normal.c_n"]
    assert force["not_told"] == fitted["not_told"] == []
    assert (tmp_path / "fitted/fit.png").stat().st_size > 10_000


def test_numbers_agree_within_their_last_digit() -> None:
    assert same("p = 1.2e-3 Pa, 12 points", "p = 1.26e-3 Pa, 12 points")
    assert not same("p = 1.2e-3 Pa", "p = 1.4e-3 Pa")
    assert not same("12 points", "13 points")
    assert not same("a 12", "b 12")
    assert agree(["..."], ["a"])
    assert file_name("# a/b.toml\nx = 1") == "a/b.toml"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(templates, "FOLDER", tmp_path)
    monkeypatch.setattr(templates, "_environment", templates._environment.__wrapped__)  # that of the folder
    return tmp_path


def test_text_is_escaped_in_html_alone(folder: Path) -> None:
    for name in ("page.html", "page.md"):
        (folder / name).write_text("{{ words }} {{ markup }}\n")
    values = {"words": "a < b", "markup": Markup("<b>c</b>")}
    assert render("page.html", **values) == "a &lt; b <b>c</b>\n"
    assert render("page.md", **values) == "a < b <b>c</b>\n"


def test_a_line_with_a_statement_alone_leaves_nothing(folder: Path) -> None:
    (folder / "list.md").write_text("A\n{% for x in xs %}\n* {{ x }}\n{% endfor %}\nB")
    assert render("list.md", xs=[1, 2]) == "A\n* 1\n* 2\nB"


def test_a_value_that_is_not_given_is_refused(folder: Path) -> None:
    (folder / "page.md").write_text("{{ missing }}")
    with pytest.raises(KeyError, match="missing"):
        render("page.md")
