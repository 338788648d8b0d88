"""Mass of the house: lines, imports, small numbers, complexity; `.venv/bin/python tests/shared/house.py` prints it.

Net lines are those with code: no docstrings, comments, blanks. The product is all but the lab and the demos.
"""

from __future__ import annotations

import ast
import io
import json
import subprocess
import sys
import tokenize
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("stickslip", "geometry", "solvers", "workflows")
LAB = ("workflows/lab/", "workflows/demos/")
SMALL = 1e-3  # literals up to here are tolerances, and what counts as zero
BLANK = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENCODING}
DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True, kw_only=True)
class Mass:
    """What files weigh; masses of parts add up."""

    files: int = 0
    gross: int = 0  # lines
    net: int = 0
    docstrings: int = 0  # lines
    imports: int = 0  # net lines of import statements
    small: int = 0  # numeric literals between 0 and SMALL
    constants: int = 0  # module constants that are numbers

    def __add__(self, other: Mass) -> Mass:
        return Mass(**{f.name: getattr(self, f.name) + getattr(other, f.name) for f in fields(self)})


def spans(nodes: Iterable[ast.AST]) -> set[int]:
    """Numbers of the lines that nodes take up."""
    return {n for node in nodes for n in range(node.lineno, (node.end_lineno or node.lineno) + 1)}


def docstrings(tree: ast.Module) -> list[ast.AST]:
    """The docstrings of a module, its classes and functions."""
    owners = (node for node in ast.walk(tree) if isinstance(node, DOCUMENTED))
    return [node.body[0] for node in owners if ast.get_docstring(node, clean=False) is not None]


def is_number(node: ast.AST | None) -> bool:
    """Whether an expression is a number, a sign before it, or a product and the like of numbers."""
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def constants(tree: ast.Module) -> int:
    """How many names a module gives to numbers: X = 3, X, Y = 1e-3, 2."""
    found = 0
    for node in tree.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            found += sum(map(is_number, values))
    return found


@cache
def weigh(path: Path) -> Mass:
    """The mass of one file."""
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    coded = {n for t in tokens if t.type not in BLANK and t.string for n in range(t.start[0], t.end[0] + 1)}
    documented = spans(docstrings(tree))
    imports = spans(node for node in ast.walk(tree) if isinstance(node, ast.Import | ast.ImportFrom))
    numbers = [n.value for n in ast.walk(tree) if isinstance(n, ast.Constant) and type(n.value) in (int, float)]
    return Mass(
        files=1,
        gross=len(text.splitlines()),
        net=len(coded - documented),
        docstrings=len(documented),
        imports=len(imports & coded),
        small=sum(0 < abs(x) <= SMALL for x in numbers),
        constants=constants(tree),
    )


def files(*folders: str) -> list[Path]:
    """Python files below folders of the repository; those of folders that are reached through links only once."""
    found = {path.resolve() for folder in folders for path in (ROOT / folder).rglob("*.py")}
    return sorted(path for path in found if path.is_relative_to(ROOT))


def is_lab(path: Path) -> bool:
    """Whether a file judges or shows the product, and is not part of it."""
    return path.relative_to(ROOT).as_posix().startswith(LAB)


def masses() -> dict[str, Mass]:
    """Of all outside tests, the product, the lab with the demos, the tests."""
    outside = files(*PACKAGES)
    parts = {
        "outside tests": outside,
        "product": [p for p in outside if not is_lab(p)],
        "lab and demos": [p for p in outside if is_lab(p)],
        "tests": files("tests"),
    }
    return {name: sum(map(weigh, paths), Mass()) for name, paths in parts.items()}


def most_complex() -> tuple[int, str]:
    """The largest cyclomatic complexity of a function outside tests, by ruff, and the function."""
    command = [Path(sys.prefix) / "bin" / "ruff", "check", "--isolated", "--select", "C901", "--output-format", "json"]
    arguments = ["--config", "lint.mccabe.max-complexity = 1", *(p for p in map(str, files(*PACKAGES)))]
    found = json.loads(subprocess.run([*map(str, command), *arguments], capture_output=True, text=True).stdout)
    name = {row["message"].split("`")[1]: int(row["message"].split("(")[1].split(" ")[0]) for row in found}
    largest = max(name, key=lambda key: name[key])
    return name[largest], largest


def table() -> str:
    """The masses as text."""
    rows = [f"{'':15}{''.join(f'{f.name:>12}' for f in fields(Mass))}{'doc/net':>9}{'imports %':>11}"]
    for name, mass in masses().items():
        numbers = "".join(f"{getattr(mass, f.name):12}" for f in fields(Mass))
        rows.append(f"{name:15}{numbers}{mass.docstrings / mass.net:9.3f}{100 * mass.imports / mass.net:11.1f}")
    return "\n".join([*rows, "most complex: {1} ({0})".format(*most_complex())])


if __name__ == "__main__":
    print(table())
