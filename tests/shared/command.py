"""Words of the command line that every run test uses, and its files read back."""

import csv
import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from stickslip.workflows.commands.cli import commands
from stickslip.workflows.scene_file.read import READY

Spoken = tuple[int, str, str]
Call = Callable[..., Spoken]
Start = Callable[..., subprocess.CompletedProcess[str]]
LIMIT = 60  # s; a process that does not end by itself
BUILT = set(commands())
READY_NAMES = sorted(path.stem for path in READY.glob("*.toml"))
COARSE = [
    "--set=geometry.mesh_size=1.0",
    "--set=geometry.contact_mesh_size=0.5",
    "--set=output.pictures=false",
    "--set=output.error=false",
]


def assert_refused(spoken: Spoken, pattern: str, folder: Path, before: list[str]) -> None:
    """Exit code 2, a line for each mistake of which one says `pattern`, and the folder as it was."""
    code, out, err = spoken
    assert (code, out) == (2, ""), (code, out, err)
    assert all(line.startswith("stickslip: ") for line in err.splitlines())
    assert re.search(pattern, err), err
    assert sorted(str(path.relative_to(folder)) for path in folder.rglob("*")) == before


def assert_said(spoken: Spoken, code: int, *said: str, alone: bool = True) -> None:
    """This exit code, and one line on stderr that says all this, alone unless stdout may have lines."""
    found, out, err = spoken
    assert (found, out if alone else "") == (code, ""), (out, err)
    assert_one_line(err)
    assert all(words in err for words in said), err


def ended(spoken: Spoken, code: int = 0) -> tuple[str, str]:
    """Standard output and error of a command that ends with this exit code."""
    assert spoken[0] == code, spoken[2]
    return spoken[1:]


def output_of(spoken: Spoken) -> str:
    """Standard output of a command that is content."""
    assert spoken[::2] == (0, "")
    return spoken[1]


def result(folder: Path) -> dict[str, Any]:
    """result.json, which must hold no NaN and no Infinity."""

    def refuse(constant: str) -> float:
        raise AssertionError(f"result.json holds {constant}")

    content: dict[str, Any] = json.loads((folder / "result.json").read_text(), parse_constant=refuse)
    return content


def table(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file."""
    return list(csv.DictReader(path.read_text().splitlines()))


def assert_one_line(err: str) -> None:
    assert (err.count("\n"), "Traceback" in err, len(err) < 300) == (1, False, True), err
