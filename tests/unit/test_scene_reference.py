"""The pages that are generated from the code are up to date."""

import re
import tomllib
from pathlib import Path

import pytest

import stickslip.workflows
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.pages import folder_map
from stickslip.workflows.lab.pages.scene_page import FILE, METHODS_HEAD, METHODS_PAGE, reference, renewed
from stickslip.workflows.scene_file.read import READY, from_dict, read

README = Path(stickslip.workflows.__file__).parents[2] / "README.md"


def test_scene_reference_is_what_the_dataclasses_say() -> None:
    """Renew it with `python -m stickslip.workflows.lab.pages.scene_page`."""
    assert FILE.read_text(encoding="utf-8") == reference()


def test_every_key_of_the_reference_has_a_unit_and_a_meaning() -> None:
    rows = [
        line.strip("|").split("|") for line in FILE.read_text(encoding="utf-8").splitlines() if line.startswith("| `")
    ]
    assert len(rows) > 40
    assert all(cell.strip() for row in rows for cell in row)


def test_the_readme_scene_is_the_ready_scene_block() -> None:
    text = re.search(r"```toml\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    shown, ready = from_dict(tomllib.loads(text[1])), read(READY / "block.toml")
    assert (shown.contacts, shown.supports, shown.geometry) == (ready.contacts, ready.supports, ready.geometry)


def test_the_page_of_methods_says_of_every_method_what_the_code_says() -> None:
    """Renew it with `python -m stickslip.workflows.lab.pages.scene_page`."""
    text = METHODS_PAGE.read_text(encoding="utf-8")
    assert text == renewed(text)
    table = text.partition(METHODS_HEAD)[2].partition("\n\n")[0]
    assert [row.split("`")[1] for row in table.splitlines() if row.startswith("| `")] == list(METHODS)


def test_a_method_without_a_row_gets_one() -> None:
    text = METHODS_PAGE.read_text(encoding="utf-8")
    without = "\n".join(line for line in text.split("\n") if not line.startswith("| `uzawa` | the classical"))
    assert without != text
    assert renewed(without) == text
    other = text.replace("| held by supports | matrix-free |", "| held or floating | any |")
    assert other != text
    assert renewed(other) == text


def test_tables_in_tables_name_their_keys() -> None:
    text = reference()
    assert "{ angle = value in time [rad], point = list of number [m], axis = list of number [-] }" in text
    assert "<class" not in text


def test_the_map_says_of_every_folder_what_its_docstring_says() -> None:
    """Renew it with `python -m stickslip.workflows.lab.pages.folder_map`."""
    text = folder_map.PAGE.read_text(encoding="utf-8")
    assert text == folder_map.renewed(text), "stale: python -m stickslip.workflows.lab.pages.folder_map"
    stale = text.replace("| `solvers/laws/` |", "| `solvers/law/` |")
    assert stale != text
    assert folder_map.renewed(stale) == text


def test_the_map_of_the_folders_has_every_package() -> None:
    root = README.parent
    packages = {
        path.parent.relative_to(root).as_posix()
        for name in folder_map.PACKAGES
        for path in (root / name).rglob("__init__.py")
    }
    assert {folder.rstrip("/") for folder, _ in folder_map.rows()} == packages | {"stickslip"}


def test_a_package_whose_first_line_is_no_sentence_is_refused(tmp_path: Path) -> None:
    for text in ("", '"""Half a sentence that\ngoes on."""\n'):
        (tmp_path / "__init__.py").write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match="must be one sentence with a full stop"):
            folder_map.first_line(tmp_path / "__init__.py")


def test_a_readme_without_the_marker_lines_is_refused() -> None:
    with pytest.raises(ValueError, match="the map lacks the lines"):
        folder_map.renewed("# stickslip\n")
