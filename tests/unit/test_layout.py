"""The plan of the house: every room has its floor, imports only point down, outside libraries stay at the edge."""

import ast
import importlib
import re
from collections.abc import Callable, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import stickslip
import stickslip.workflows
from shared import house

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geometry", "solvers", "workflows")
FACE = ROOT / "stickslip"
SOURCES = [*sorted(FACE.glob("*.py")), *sorted(p for name in PACKAGES for p in (ROOT / name).rglob("*.py"))]
# A room is a folder of a package, or a file beside such folders. It imports itself and the rooms below it.
FLOORS = {  # from the ground up
    "geometry": "errors units memory keys arrays protocols amplitude expression field mesh_sizes curved_facets shape"
    " form_cache bisection dolfinx_versions mesh surfaces user_files nested_mesh builders obstacles",
    "solvers": "parallel iteration linear laws scene fem contact effects system interface metrics newton tangent"
    " methods classical method_registry stepping results accuracy simulation",
    "workflows": "formats pictures writers scene_file run accuracy sweep cost commands demos",
    "": "public __main__",  # the public face; what stands on it is a script that a user might have written
    "workflows.lab": "verification benchmarks studies pages commands",  # nothing of the product imports it
}
DEMOS = (  # programs for readers, who are to see the calls of gmsh, UFL, dolfinx, PETSc and pyvista
    "workflows/demos/",
    "workflows/lab/benchmarks/peers/dolfinx_by_hand.py",  # what one writes without us
)
VERSIONS = "geometry/dolfinx_versions.py"
LIMITS = {  # what the house may weigh; a limit is lowered when the house got lighter
    ("outside tests", "files"): 459,
    ("outside tests", "gross"): 84_704,
    ("outside tests", "net"): 56_810,
    ("product", "gross"): 65_774,
    ("product", "small"): 58,
    ("outside tests", "constants"): 738,
    ("tests", "gross"): 53_347,
}
IMPORTS, DOCSTRINGS = 0.116, 0.26  # lines per net line outside tests: no more imports, no fewer docstrings
UFL = ("elastic_energy", "contact_forms", "mean_dilatation", "forms")
FORMS = tuple(f"solvers/fem/{name}.py" for name in UFL)  # where UFL is written


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def module_of(path: Path) -> str:
    """As it is imported: `stickslip` has links to the packages beside it."""
    parts = path.relative_to(FACE if path.parent == FACE else ROOT).with_suffix("").parts
    return ".".join(("stickslip", *parts)).removesuffix(".__init__")


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


@cache
def imports(path: Path) -> frozenset[str]:
    """Everything that a file imports, wherever in the file: put off into a function, or for the type checker alone."""
    return frozenset(target for node in ast.walk(tree_of(path)) for target in targets(node))


def users(*libraries: str) -> set[str]:
    """Files that import one of the libraries, demos left out."""
    found = {name_of(path) for path in SOURCES if any(t.split(".")[0] in libraries for t in imports(path))}
    return {name for name in found if not name.startswith(DEMOS)}


def test_sources_are_found() -> None:
    assert len(SOURCES) > 50
    assert "numpy" in imports(ROOT / "solvers/contact/admissible_set.py")
    assert "stickslip.geometry.dolfinx_versions" in imports(ROOT / "solvers/fem/forms.py")


ROOMS = [
    ".".join(filter(None, ("stickslip", house, room))) for house, rooms in FLOORS.items() for room in rooms.split()
]  # from the ground up


def room_of(module: str) -> str:
    """Room of a module; of a package itself, the package.

    >>> room_of("stickslip.solvers.fem.forms"), room_of("stickslip.workflows")
    ('stickslip.solvers.fem', 'stickslip.workflows')
    >>> room_of("stickslip.workflows.lab.verification.hard.judge")
    'stickslip.workflows.lab.verification'
    """
    return ".".join(module.split(".")[: 4 if module.startswith("stickslip.workflows.lab.") else 3])


def floor_of(module: str) -> float:
    """Number of the floor, from the ground up; a package itself lies just below its rooms."""
    room = room_of(module)
    return ROOMS.index(room) if room in ROOMS else next(n for n, r in enumerate(ROOMS) if r.startswith(room)) - 0.5


def arrows() -> dict[str, set[str]]:
    """Modules of this repository, and those that each imports."""
    return {name: {t for t in imports(path) if t in MODULES} - {name} for name, path in MODULES.items()}


def test_every_room_has_a_floor() -> None:
    found = {room_of(name) for name in MODULES} - {
        "stickslip",
        "stickslip.workflows.lab",
        *(f"stickslip.{name}" for name in PACKAGES),
    }
    assert sorted(found) == sorted(ROOMS), "a new room needs its place in FLOORS"


def test_the_page_of_the_architecture_shows_these_floors() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    block = re.search(r"^    geometry: .*?\n\n", page, re.DOTALL | re.MULTILINE)
    assert re.sub(r"\w[\w ]*:", "", block[0]).split() == " ".join(FLOORS.values()).split()


def test_imports_only_point_down() -> None:
    upwards = [
        f"{name} -> {target}"
        for name, targets in arrows().items()
        for target in sorted(targets)
        if room_of(name) != room_of(target) and floor_of(target) >= floor_of(name)
    ]
    assert not upwards, "imports that run back up:\n" + "\n".join(upwards)


@pytest.mark.parametrize("each", [str, room_of], ids=["files", "rooms"])
def test_no_import_runs_in_a_circle(each: Callable[[str], str]) -> None:
    graph: dict[str, set[str]] = {}
    for name, targets in arrows().items():
        graph.setdefault(each(name), set()).update({each(target) for target in targets} - {each(name)})
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"import circle: {' <- '.join(error.args[1])}")


def test_no_import_is_hidden_from_the_interpreter() -> None:
    hidden = [name_of(p) for p in SOURCES if "TYPE_CHECKING" in p.read_text(encoding="utf-8")]
    assert not hidden, "an import for the type checker alone is an arrow too: move what both sides need below them"


@pytest.mark.parametrize(
    ("libraries", "home"),
    [
        (("gmsh",), "geometry/"),
        (("dolfinx", "basix", "ffcx", "ufl"), VERSIONS),
        (("pyvista", "vtk", "vtkmodules", "matplotlib"), "workflows/"),
        (("h5py",), ("workflows/", "geometry/user_files/hdf5_datasets.py")),
        (("meshio",), ("geometry/user_files/foreign_formats.py", "workflows/lab/")),
        (("typer", "rich"), "workflows/"),
        (("jinja2",), "workflows/formats/templates.py"),
    ],
)
def test_outside_libraries_stay_at_the_edge(libraries: tuple[str, ...], home: str | tuple[str, ...]) -> None:
    astray = {name for name in users(*libraries) if not name.startswith(home)}
    assert not astray


def test_petsc_is_met_where_matrices_are() -> None:
    astray = {name for name in users("petsc4py") if not name.startswith(("solvers/", "workflows/lab/"))} - {VERSIONS}
    assert not astray
    inside = {name for name in users("petsc4py") if name.startswith("solvers/methods/")}  # methods see arrays
    assert not inside


def test_ufl_is_written_where_forms_are() -> None:
    written = set()
    for path in SOURCES:
        nodes = list(ast.walk(tree_of(path)))
        imported = any(isinstance(n, ast.ImportFrom) and any(a.name == "ufl" for a in n.names) for n in nodes)
        if imported or any(isinstance(n, ast.Attribute) and n.attr == "ufl" for n in nodes):
            written.add(name_of(path))
    assert {name for name in written if not name.startswith("solvers/effects/")} - {VERSIONS} == set(FORMS)


def test_the_audit_imports_nothing_of_the_methods() -> None:
    reached, waiting = set[str](), ["stickslip.solvers.results.audit"]
    while waiting:
        name = waiting.pop()
        if name in MODULES and name not in reached:
            reached.add(name)
            waiting += imports(MODULES[name])
    rooms = ("linear", "interface", "metrics", "newton", "tangent", "methods", "classical", "stepping")
    solving = {f"stickslip.solvers.{room}" for room in rooms}
    assert solving <= set(ROOMS)
    assert not {name for name in reached if room_of(name) in solving} - solving


@pytest.mark.parametrize("name", ["stickslip", *(f"stickslip.{name}" for name in PACKAGES)])
def test_packages_are_those_of_this_repository(name: str) -> None:
    found = importlib.import_module(name).__file__
    assert Path(found).resolve().is_relative_to(ROOT)


def test_the_house_is_no_heavier_than_its_limits() -> None:
    mass = house.masses()
    heavy = {
        f"{part}: {quantity}": (getattr(mass[part], quantity), most)
        for (part, quantity), most in LIMITS.items()
        if getattr(mass[part], quantity) > most
    }
    assert not heavy, "(is, limit)"
    outside = mass["outside tests"]
    assert outside.imports <= IMPORTS * outside.net
    assert outside.docstrings >= DOCSTRINGS * outside.net


def test_every_file_says_its_idea_first() -> None:
    silent = {name_of(p) for p in SOURCES if p.stat().st_size and ast.get_docstring(tree_of(p)) is None}
    assert not silent


def test_folders_are_packages_and_no_file_is_a_ragbag() -> None:
    folders = {p.parent for p in SOURCES} - {ROOT}
    assert not {name_of(folder) for folder in folders if not (folder / "__init__.py").exists()}
    assert not {p.stem for p in SOURCES} & {"utils", "helpers", "common", "misc"}
    assert not list((ROOT / "tests").rglob("__init__.py"))


def test_one_version_everywhere() -> None:
    citation = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert stickslip.__version__ == citation[1]


def test_below_the_simulation_nobody_asks_the_scene() -> None:
    """It is resolved once: rooms below work on the `Problem`; an effect alone says what of a scene switches it on."""
    may = {"stickslip.solvers.scene", "stickslip.solvers.effects", "stickslip.solvers.simulation"}
    below = [p for p in SOURCES if name_of(p).startswith("solvers/") and room_of(module_of(p)) not in may]
    assert len(below) > 50
    assert not {name_of(path) for path in below if "stickslip.solvers.scene.scene" in imports(path)}
    attributes = {(name_of(p), n.attr) for p in below for n in ast.walk(tree_of(p)) if isinstance(n, ast.Attribute)}
    assert not {name for name, attribute in attributes if attribute == "scene"}


def test_signatures_of_the_solvers_name_their_types() -> None:
    """No public function of a module or class of solvers/ takes or returns `Any`; mypy holds the rest."""
    vague = set()
    for path in (p for p in SOURCES if name_of(p).startswith("solvers/")):
        tree = tree_of(path)
        owners = [tree, *(n for n in ast.walk(tree) if isinstance(n, ast.ClassDef))]
        for function in (n for owner in owners for n in owner.body if isinstance(n, ast.FunctionDef)):
            arguments = [n.annotation for n in ast.walk(function.args) if isinstance(n, ast.arg)]
            named = [n for a in (*arguments, function.returns) if a is not None for n in ast.walk(a)]
            public = not function.name.startswith("_") or function.name.startswith("__")
            if public and any(isinstance(n, ast.Name) and n.id == "Any" for n in named):
                vague.add(f"{name_of(path)}: {function.name}")
    assert not vague
