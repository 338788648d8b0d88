"""The pages' console blocks are run: `python -m stickslip.workflows.lab.pages.console PAGE...` compares what is shown.

A page is a program: a block of TOML, Python or .geo whose first line is a comment with a file's name is written to that
file, and in a `console` block each line that begins with `$ `, with those behind it that begin with `> `, is run by
bash, in one folder for the page. What a page shows of the output is held against it: words must be the same, numbers
agree within one unit of their last digit, seconds are free; a line `...` stands for any lines. `--renew` writes what is
printed into the page, except where it has such a line.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

ROOT = Path(__file__).resolve().parents[3]
WORK = ROOT / "build" / "pages"
FENCE = re.compile(r"^```(\w+)([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE_NAME = re.compile(r"(?:#|//) ([\w./-]+\.\w+)\n")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
RULER = re.compile(r"[─━╌-]{2,}")  # lines of tables, as wide as the widest number
SLOW = re.compile(r".*, about \d+ s \.\.\.")  # what a slow machine announces
ROUNDING = 1e-12  # what is smaller is left by the arithmetic, and differs between machines


@dataclass(frozen=True)
class Command:
    """A command of a page, and what the page shows of its output."""

    line: str  # one or more
    shown: tuple[str, ...]


def blocks(text: str) -> Iterator[re.Match[str]]:
    """The fenced blocks of a page: language, the rest of the first line, content."""
    yield from FENCE.finditer(text)


def file_name(content: str) -> str | None:
    """The file that a block is, by its first line.

    >>> file_name("// plate.geo\\nx = 1;"), file_name("# Pressed\\nx = 1")
    ('plate.geo', None)
    """
    found = FILE_NAME.match(content)
    return found[1] if found else None


def commands(content: str) -> list[Command]:
    """Commands of a console block.

    >>> commands("$ for x in 1 2\\n> do echo $x; done\\n1\\n2\\n$ true\\n")
    [Command(line='for x in 1 2\\ndo echo $x; done', shown=('1', '2')), Command(line='true', shown=())]
    """
    found: list[tuple[list[str], list[str]]] = []
    for line in content.splitlines():
        if line.startswith("$ "):
            found.append(([line[2:]], []))
        elif not found:
            raise ValueError(f"a console block begins with '$ ', not with {line!r}")
        elif not found[-1][1] and line.startswith("> "):
            found[-1][0].append(line[2:])
        else:
            found[-1][1].append(line)
    return [Command("\n".join(line), tuple(shown)) for line, shown in found]


def same(shown: str, printed: str) -> bool:
    """Whether a line says what the page shows.

    >>> same("N = 0.25 N after 1.2 s", "N =  0.2512 N after 37 s"), same("N = 0.25 N", "N = 0.27 N")
    (True, False)
    """
    one, other = (RULER.sub("--", " ".join(line.split())) for line in (shown, printed))
    if NUMBER.split(one) != NUMBER.split(other):
        return False
    for a, b in zip(NUMBER.finditer(one), NUMBER.finditer(other), strict=True):
        seconds = re.match(r"(?: to [\d.]+)? s\b", one[a.end() :])
        if not seconds and abs(float(a[0]) - float(b[0])) > max(1.001 * last_digit(a[0]), ROUNDING):
            return False
    return True


def last_digit(number: str) -> float:
    """One unit of the last digit; of a whole number none.

    >>> last_digit("0.25"), last_digit("1.4e-7"), last_digit("12")
    (0.01, 1e-08, 0.0)
    """
    mantissa, _, exponent = number.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(f"1e{int(exponent or 0) - decimals}") if decimals or exponent else 0.0


def agree(shown: Sequence[str], printed: Sequence[str]) -> bool:
    """Whether the output is what the page shows; a line `...` stands for any lines, also none.

    >>> agree(["a", "...", "z"], ["a", "b", "c", "z"]), agree(["a"], ["a", "b"])
    (True, False)
    """
    if not shown:
        return not printed
    if shown[0].strip() == "...":
        return any(agree(shown[1:], printed[k:]) for k in range(len(printed) + 1))
    return bool(printed) and same(shown[0], printed[0]) and agree(shown[1:], printed[1:])


def printed_by(command: Command, folder: Path) -> list[str]:
    """Run a command and return both streams together, without empty lines at the ends.

    Raises:
        ValueError: it failed; a page that shows a failure says so with `|| echo`.
    """
    there = {
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "OMP_NUM_THREADS": "1",
        "LC_ALL": "C.UTF-8",
        "COLUMNS": "118",
        "NO_COLOR": "1",
    }
    done = subprocess.run(
        ["/bin/bash", "-e", "-o", "pipefail", "-c", command.line],
        cwd=folder,
        env={**os.environ, **there},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if done.returncode:
        raise ValueError(f"$ {command.line}\nexit code {done.returncode}\n{done.stdout}")
    lines = (line.rstrip() for line in done.stdout.strip("\n").splitlines())
    return [line for line in lines if not SLOW.fullmatch(line)]


def played(text: str, folder: Path) -> tuple[str, list[str]]:
    """A page after its blocks were written and run, in an empty folder: as it should be, and what differs."""
    complaints: list[str] = []

    def play(block: re.Match[str]) -> str:
        language, info, content = block.groups()
        if language != "console":
            name = file_name(content)
            if name is not None:
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(content, encoding="utf-8")
            return block[0]
        lines: list[str] = []
        for command in commands(content):
            printed = printed_by(command, folder)
            right = agree(command.shown, printed)
            cut = any(line.strip() == "..." for line in command.shown)
            if not right:
                complaints.append("\n".join([f"$ {command.line}", *printed]))
            lines += ["$ " + command.line.replace("\n", "\n> "), *(command.shown if right or cut else printed)]
        return "\n".join([f"```console{info}", *lines, "```"])

    return FENCE.sub(play, text), complaints


def main(
    pages: Annotated[list[Path], typer.Argument(help="pages, or folders of them")],
    renew: Annotated[bool, typer.Option("--renew", help="write into the pages what is printed")] = False,
) -> None:
    """Run the console blocks of pages and compare what they print."""
    wrong = 0
    for page in (each for path in pages for each in (sorted(path.rglob("*.md")) if path.is_dir() else [path])):
        text = page.read_text(encoding="utf-8")
        if "\n```console" not in text:
            continue
        folder = WORK / page.stem
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        print(page, flush=True)
        try:
            new, complaints = played(text, folder)
        except ValueError as error:
            new, complaints = text, [str(error)]
        for complaint in complaints:
            print(f"{page}: {'renewed' if renew and new != text else 'otherwise than the page shows'}:\n{complaint}\n")
        if renew:
            page.write_text(new, encoding="utf-8")
        wrong += len(complaints) if not renew or new == text else 0
    if wrong:
        raise SystemExit(f"{wrong} commands print something else than the pages show")


if __name__ == "__main__":
    typer.run(main)
