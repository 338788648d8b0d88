"""The arrows point one way: geometry <- solvers <- workflows, outside libraries stay at the edge."""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import stickslip
import workflows

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geometry", "solvers", "workflows")
SOURCES = [ROOT / "stickslip.py", *sorted(p for name in PACKAGES for p in (ROOT / name).rglob("*.py"))]
VERSIONS = "geometry/dolfinx_versions.py"
FORMS = ("solvers/fem/smoothed_laws.py", "solvers/fem/forms.py")  # where UFL is written


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


@cache
def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


MODULES = {module_of(path): path for path in SOURCES}


def targets(node: ast.AST) -> Iterator[str]:
    """Modules that an import statement names: `from a import b` names a.b if that is a module, else a."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, "relative imports hide where an arrow points"
        for alias in node.names:
            inner = f"{node.module}.{alias.name}"
            yield inner if inner in MODULES else str(node.module)


def imports(path: Path) -> set[str]:
    """Everything that a file imports, wherever in the file."""
    return {target for node in ast.walk(tree_of(path)) for target in targets(node)}


def imports_at_run_time(path: Path) -> set[str]:
    """All but what the type checker alone sees: a cycle put off into a function is a cycle."""
    found: set[str] = set()
    waiting: list[ast.AST] = [tree_of(path)]
    while waiting:
        node = waiting.pop()
        found |= set(targets(node))
        only_types = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        waiting += node.orelse if isinstance(node, ast.If) and only_types else list(ast.iter_child_nodes(node))
    return found


def users(*libraries: str) -> set[str]:
    """Files that import one of the libraries."""
    return {name_of(path) for path in SOURCES if any(t.split(".")[0] in libraries for t in imports(path))}


def test_sources_are_found() -> None:
    assert len(SOURCES) > 50
    assert "numpy" in imports(ROOT / "solvers/contact/admissible_set.py")
    assert "geometry.dolfinx_versions" in imports(ROOT / "solvers/fem/forms.py")


@pytest.mark.parametrize(("lower", "upper"), [("geometry", ("solvers", "workflows")), ("solvers", ("workflows",))])
def test_lower_layers_know_nothing_of_upper_ones(lower: str, upper: tuple[str, ...]) -> None:
    upwards = {name for name in users(*upper, "stickslip") if name.startswith(f"{lower}/")}
    assert not upwards


def test_no_import_cycle_even_inside_functions() -> None:
    own = {name: {t for t in imports_at_run_time(path) if t in MODULES} - {name} for name, path in MODULES.items()}
    try:
        TopologicalSorter(own).prepare()
    except CycleError as error:
        pytest.fail(f"import cycle: {' -> '.join(error.args[1])}")


def test_only_effects_name_the_scene_for_the_type_checker_alone() -> None:
    # an effect's functions take the scene, and the scene holds the effects' nouns
    hidden = {name_of(p) for p in SOURCES if imports(p) - imports_at_run_time(p)}
    assert {name.rpartition("/")[0] for name in hidden} <= {"solvers/effects"}


@pytest.mark.parametrize(
    ("libraries", "home"),
    [
        (("gmsh",), "geometry/"),
        (("dolfinx", "basix", "ffcx", "ufl"), VERSIONS),
        (("pyvista", "vtk", "vtkmodules", "matplotlib", "h5py", "meshio"), "workflows/"),
        (("typer", "rich"), "workflows/"),
        (("slepc4py",), "solvers/"),
    ],
)
def test_outside_libraries_stay_at_the_edge(libraries: tuple[str, ...], home: str) -> None:
    astray = {name for name in users(*libraries) if not name.startswith(home)}
    assert not astray


def test_petsc_is_met_where_matrices_are() -> None:
    astray = {name for name in users("petsc4py") if not name.startswith("solvers/")} - {VERSIONS}
    assert not astray
    inside = {name for name in users("petsc4py") if name.startswith("solvers/methods/")}  # methods see arrays
    assert inside == {f"solvers/methods/{name}.py" for name in ("regularised", "smoothed_forces")}


def test_ufl_is_written_where_forms_are() -> None:
    written = set()
    for path in SOURCES:
        nodes = list(ast.walk(tree_of(path)))
        imported = any(isinstance(n, ast.ImportFrom) and any(a.name == "ufl" for a in n.names) for n in nodes)
        if imported or any(isinstance(n, ast.Attribute) and n.attr == "ufl" for n in nodes):
            written.add(name_of(path))
    assert written - {VERSIONS} == set(FORMS)


@pytest.mark.parametrize("audit", ["solvers/results/audit.py"])
def test_the_audit_imports_nothing_of_the_methods(audit: str) -> None:
    reached, waiting = set(), [module_of(ROOT / audit)]
    while waiting:
        name = waiting.pop()
        if name in MODULES and name not in reached:
            reached.add(name)
            waiting += imports_at_run_time(MODULES[name])
    assert not {name for name in reached if name.startswith("solvers.methods")}
    assert not reached & {
        "solvers.stepping.stepper",
        "solvers.interface.schur_complement",
        "solvers.interface.factorised",
        "solvers.interface.problem",
    }


@pytest.mark.parametrize("name", [*PACKAGES, "stickslip"])
def test_packages_are_those_of_this_repository(name: str) -> None:
    found = importlib.import_module(name).__file__
    assert found is not None
    assert Path(found).resolve().is_relative_to(ROOT)


def test_no_file_is_longer_than_one_idea() -> None:
    lengths = {name_of(p): len(p.read_text(encoding="utf-8").splitlines()) for p in SOURCES}
    assert not {name: n for name, n in lengths.items() if n > 500}


def test_every_file_says_its_idea_first() -> None:
    silent = {name_of(p) for p in SOURCES if p.stat().st_size and ast.get_docstring(tree_of(p)) is None}
    assert not silent


def test_folders_are_packages_and_no_file_is_a_ragbag() -> None:
    folders = {p.parent for p in SOURCES} - {ROOT}
    assert not {name_of(folder) for folder in folders if not (folder / "__init__.py").exists()}
    assert not {p.stem for p in SOURCES} & {"utils", "helpers", "common", "misc"}
    assert not list((ROOT / "tests").rglob("__init__.py"))


def test_one_version_everywhere() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert citation is not None
    assert {project["version"], workflows.VERSION, stickslip.__version__, citation[1]} == {project["version"]}
