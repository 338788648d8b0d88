"""`stickslip verify`: solve the verification problems with every method, and hold computed against expected figures."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from pkgutil import iter_modules

from rich.console import Console
from rich.table import Table

from stickslip.geometry.errors import SceneError, StickslipError, nearest
from stickslip.workflows.lab.verification import cases
from stickslip.workflows.lab.verification.check import PROBLEMS, Case, Check

for module in iter_modules(cases.__path__, f"{cases.__name__}."):
    import_module(module.name)
CASES: Mapping[str, Case] = dict(sorted(PROBLEMS.items(), key=lambda named: named[1].checks.__module__))
Row = tuple[str, str, Check]  # case, method, result


def verify(names: Sequence[str], every_row: bool = False) -> bool:
    """Run the named problems, or all if no name is given, and print a line of each, and its figures that fail.

    Args:
        every_row: print all figures.

    Returns:
        Whether every check passed.

    Raises:
        SceneError: a verification problem of that name does not exist.
    """
    for name in names:
        if name not in CASES:
            raise SceneError(f"{name}: no such verification problem; {nearest(name, CASES)}")
    console = Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else 160)
    total, failed = 0, 0
    for name in dict.fromkeys(names or CASES):
        rows = list(solve(name))
        wrong = [row for row in rows if not row[2].passed]
        console.print(line(name, len(rows), len(wrong)), soft_wrap=True)
        if shown := rows if every_row else wrong:
            console.print(table(shown, CASES[name].about))
        total += len(rows)
        failed += len(wrong)
    console.print(f"{failed} of {total} checks failed" if failed else f"all {total} checks passed")
    return failed == 0


def line(name: str, count: int, failed: int) -> str:
    """Line that is printed of a problem.

    >>> line("zeros", 9, 2)
    'zeros              2 of 9 FAILED  no force, friction, increment, bound or touch: nothing changes'
    """
    said = f"{failed} of {count} FAILED" if failed else f"{count} passed"
    return f"{name:<{max(map(len, CASES))}}  {said:>14}  {CASES[name].about}"


def solve(name: str) -> Iterator[Row]:
    """The checks of one problem with its methods; a method that raises an error yields one failed check with it."""
    for method in CASES[name].methods:
        try:
            for check in CASES[name].checks(method):
                yield name, method, check
        except StickslipError as error:
            yield name, method, Check(f"not solved: {error}", float("nan"), 0.0, 0.0, relative=False)


def table(rows: Sequence[Row], about: str) -> Table:
    """Rows as a rich table."""
    drawn = Table(title=about, title_justify="left")
    for heading in ("case", "quantity", "method"):
        drawn.add_column(heading, overflow="fold")
    for heading in ("computed", "reference", "deviation", "allowed", "pass"):
        drawn.add_column(heading, justify="right", no_wrap=True)
    for name, method, check in rows:
        kind = "rel" if check.relative else "abs"
        drawn.add_row(
            name,
            check.name,
            method,
            f"{check.computed:.9g}",
            f"{check.reference:.9g}",
            f"{check.deviation:.1e} {kind}",
            f"{check.tolerance:.1e}",
            "yes" if check.passed else "NO",
            style=None if check.passed else "bold red",
        )
    return drawn
