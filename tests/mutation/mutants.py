"""Mutation testing: mutmut changes the code in small ways, and every change that no test notices has to be explained.

`make mutants` tests all modules of mutants.toml, `make mutants ONLY="laws path"` some of them, on one core, in one to
ten minutes each. It works on copies in build/mutants; log.txt there is mutmut's own. One operator, number, name or
argument is changed at a time, then the tests of the module that call its function are run, until one fails: those that
call few functions first. A test that passes only after another would seem to notice every change, so all are run
backwards before. Mutants with a reason are not run: all tests would pass, which takes longest.

Exit code 1: a mutant survives without a reason. Then a test is missing; or the change makes no difference, and the
reason belongs into mutants.toml. A mutant is known there by its function, the line that was, and the line that is now,
so that a reason outlives other changes of the file. Properties, enums, constants and defaults of fields stay as they
are: mutmut has no mutants of them.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
WORK = ROOT / "build" / "mutants"  # copies of the code, a folder for each module
TABLE = Path(__file__).with_name("mutants.toml")
PLUGINS = Path(__file__).parent  # of pytest: reversed_order, closest_first
PACKAGE = "stickslip"
COPIED = ("geometry", "solvers", "workflows", "tests", "stickslip", "pyproject.toml")
SURVIVED = 0  # exit code of the tests
NOTICED = ("killed", "timeout", "segfault", "suspicious")  # endings by which a test has noticed the change


@dataclass(frozen=True)
class Mutant:
    """A changed line that no test notices."""

    function: str  # dotted
    was: str
    now: str

    def __str__(self) -> str:
        return f"{self.function}\n    - {self.was}\n    + {self.now}"


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Why some changes of a function need no test: those of a line, to some lines, or alike."""

    function: str  # dotted; * at the end: all that begin so
    why: str
    was: str | None = None
    now: tuple[str, ...] = ()
    like: str | None = None  # regular expression, looked for in the line that is now

    def __post_init__(self) -> None:
        if not (self.now or self.like):
            raise ValueError(f"mutants.toml, {self.function}: `now` or `like` says which changes the reason is for")

    def holds(self, mutant: Mutant) -> bool:
        """Whether it is a reason for this mutant."""
        begin, star, _ = self.function.partition("*")
        here = mutant.function.startswith(begin) if star else mutant.function == begin
        change = mutant.now in self.now if self.like is None else re.search(self.like, mutant.now) is not None
        return here and change and self.was in (None, mutant.was)


@dataclass(frozen=True)
class Tally:
    """The mutants of a module."""

    module: str
    counts: Mapping[str, int]  # by ending, as mutmut calls it
    survivors: tuple[Mutant, ...]


def reasons(table: Mapping[str, Any]) -> tuple[Reason, ...]:
    """The reasons in mutants.toml.

    >>> reasons({"equivalent": [{"function": "a.b", "was": "x > 0", "now": ["x >= 0"], "why": "x is never 0"}]})
    (Reason(function='a.b', why='x is never 0', was='x > 0', now=('x >= 0',), like=None),)
    """
    return tuple(Reason(**{**row, "now": tuple(row.get("now", ()))}) for row in table.get("equivalent", ()))


def unexplained(survivors: Sequence[Mutant], known: Sequence[Reason]) -> list[Mutant]:
    """The survivors without a reason.

    >>> known = [Reason(function="a.*", was="x > 0", now=("x >= 0",), why="x is never 0")]
    >>> [mutant.now for mutant in unexplained([Mutant("a.b", "x > 0", now) for now in ("x >= 0", "x > 1")], known)]
    ['x > 1']
    """
    return [mutant for mutant in survivors if not any(reason.holds(mutant) for reason in known)]


def mutate(module: str, known: Sequence[Reason], files: Sequence[str], tests: Sequence[str]) -> Tally:
    """Mutate files with their tests, in a copy of the code; mutants with a known reason count as survivors."""
    _check_order(module, tests)
    folder = WORK / module
    shutil.rmtree(folder, ignore_errors=True)  # mutmut would keep copies of files that have changed since
    folder.mkdir(parents=True)
    for name in COPIED:
        (folder / name).symlink_to(ROOT / name)
    lines = {
        "source_paths": sorted({f"{PACKAGE}/{name.split('/')[0]}" for name in files}),  # named as they are imported
        "only_mutate": [f"{PACKAGE}/{name}" for name in files],
        "also_copy": COPIED,
        # a traceback would read the file, fifty times as long with all mutants in it: that takes seconds
        "pytest_add_cli_args": ["--tb=no", "-p", "no:cacheprovider", "-p", "closest_first", "-m", "not slow"],
        "pytest_add_cli_args_test_selection": tests,
        "timeout_multiplier": ["5"],
        "timeout_constant": ["5"],  # s, five times, for fixtures: mutmut measures tests alone
        "track_dependencies": ["false"],
        "use_git_change_detection": ["false"],
    }
    text = "".join(f"{key} =\n" + "".join(f"    {value}\n" for value in values) for key, values in lines.items())
    (folder / "setup.cfg").write_text("[mutmut]\n" + text)
    _mutmut(folder, "none")  # no mutant's name: all are written, and which tests call them
    for data, name in _mutants(folder):
        if not unexplained([_mutant(name, data.path)], known):
            data.exit_code_by_key[name] = SURVIVED
            data.save()
    return Tally(module, *_results(folder, _mutmut(folder)))


def _mutmut(folder: Path, *names: str) -> int:
    """Run the mutants of those names, or all that have no ending yet."""
    command = [sys.executable, "-m", "mutmut", "run", "--max-children", "1", *names]
    with (folder / "log.txt").open("a") as log:
        return subprocess.run(command, cwd=folder, env=_with_plugins(), stdout=log, stderr=log).returncode


def _check_order(module: str, tests: Sequence[str]) -> None:
    """Exit if tests fail in another order: one that needs another before it would seem to notice every mutant."""
    options = ["-q", "-p", "no:cacheprovider", "-p", "reversed_order", "-m", "not slow"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests],
        cwd=ROOT,
        env=_with_plugins(),
        capture_output=True,
        text=True,
    )
    if run.returncode:
        sys.exit(f"{run.stdout[-3000:]}\n{module}: these tests fail in reverse order")


def _with_plugins() -> dict[str, str]:
    paths = [str(PLUGINS), *filter(None, [os.environ.get("PYTHONPATH")])]
    # CHOLMOD asks OpenMP for several threads, which are not there after a fork: it waits, and would seem to notice
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_THREAD_LIMIT": "1"}


def _results(folder: Path, code: int) -> tuple[Mapping[str, int], tuple[Mutant, ...]]:
    from mutmut.stats import status_by_exit_code  # it is no package of .venv

    counts: Counter[str] = Counter()
    survivors: list[Mutant] = []
    for data, name in _mutants(folder):
        status = status_by_exit_code[data.exit_code_by_key[name]]
        counts[status] += 1
        if status not in NOTICED:
            survivors.append(_mutant(name, data.path))
    if code or not counts or counts["not checked"]:
        tail = "".join((folder / "log.txt").read_text(errors="replace").splitlines(keepends=True)[-30:])
        sys.exit(f"{tail}\nmutmut did not finish; all of it is in {folder / 'log.txt'}")
    return counts, tuple(survivors)


def _mutants(folder: Path) -> Iterator[tuple[Any, str]]:
    """Names of all mutants, each behind the data of its file."""
    from mutmut import configuration
    from mutmut.mutation.data import SourceFileMutationData
    from mutmut.utils.file_utils import walk_mutatable_files

    with chdir(folder):  # as mutmut expects it
        configuration.reset_config()
        for path in walk_mutatable_files():
            data = SourceFileMutationData(path=path)
            data.load()
            for name in list(data.exit_code_by_key):
                yield data, name


def _mutant(name: str, path: Path) -> Mutant:
    from mutmut.mutation.diff_apply import get_diff_for_mutant

    module, _, function = name.partition("__mutmut_")[0].removeprefix(f"{PACKAGE}.").rpartition(".")
    function = function.removeprefix("x_").removeprefix("xǁ").replace("ǁ", ".")
    changed = [line for line in get_diff_for_mutant(name, path=path).splitlines()[2:] if line[:1] in ("-", "+")]
    was, now = (" ".join(line[1:].strip() for line in changed if line[0] == sign) for sign in "-+")
    return Mutant(f"{module}.{function}", was, now)


def report(tallies: Sequence[Tally], known: Sequence[Reason]) -> Iterator[str]:
    """A table of the modules, and the survivors without a reason.

    >>> for line in report([Tally("laws", {"killed": 8, "no tests": 1}, (Mutant("a.b", "x > 0", "x > 1"),))], []):
    ...     print(line)
    module                mutants   noticed  survived  explained
    laws                        9         8         1          0
    <BLANKLINE>
    a.b
        - x > 0
        + x > 1
    """
    yield f"{'module':20} {'mutants':>8} {'noticed':>9} {'survived':>9} {'explained':>10}"
    for tally in tallies:
        noticed, left = sum(tally.counts.get(each, 0) for each in NOTICED), len(tally.survivors)
        explained = left - len(unexplained(tally.survivors, known))
        yield f"{tally.module:20} {sum(tally.counts.values()):8} {noticed:9} {left:9} {explained:10}"
    for tally in tallies:
        for mutant in unexplained(tally.survivors, known):
            yield f"\n{mutant}"


def main() -> int:
    """Test the modules that are asked for, print the report."""
    table = tomllib.loads(TABLE.read_text())
    modules, known = table["modules"], reasons(table)
    parser = argparse.ArgumentParser(prog="make mutants", description="ONLY=… names modules of mutants.toml")
    parser.add_argument("only", nargs="*", metavar="module")
    only = parser.parse_args().only or list(modules)
    if wrong := [name for name in only if name not in modules]:
        parser.error(f"no such module: {', '.join(wrong)}; there are {', '.join(modules)}")
    tallies = []
    for name in only:
        tallies.append(mutate(name, known, **modules[name]))
        print("\n".join(report(tallies[-1:], known)), flush=True)
    if len(tallies) > 1:
        print("\nAll modules")
        print("\n".join(list(report(tallies, known))[: len(tallies) + 1]))
    return int(any(unexplained(tally.survivors, known) for tally in tallies))


if __name__ == "__main__":
    sys.exit(main())
