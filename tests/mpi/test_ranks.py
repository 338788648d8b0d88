"""On several ranks bodies, surfaces, cells and errors are those of one."""

import json
import subprocess
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict
from functools import cache
from itertools import cycle, product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared import on_ranks
from shared.cases import slow
from shared.cells import MODELS, Cell, refused, solved, whole
from shared.command import result
from shared.drawn import write_hinge
from shared.ranks import each_told, mpirun, options, told
from stickslip.geometry import dolfinx_versions as dx
from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.commands.cli import app, guarded
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read

SCENES = {
    "block": ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25"],
    "cube": ["geometry.mesh_size=0.25", "body_force.block.force=['1e-3*E*sin(pi*x)', 0.0, 'y*z*t*1e-3']"],
    "foundation": ["geometry.mesh_size=0.2"],
    "half_ball": ["geometry.order=2", "geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.1", "steps.count=2"],
    "axisymmetric": ["geometry.mesh_size=0.2", "geometry.contact_mesh_size=0.02", "steps.count=4"],
    "two_blocks": ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.3", "geometry.contact_mesh_size=0.12"],
    "cylinders": ["geometry.mesh_size=2.0", "geometry.lower_mesh_size=2.7", "geometry.contact_mesh_size=0.12"],
    "arch": ["geometry.mesh_size=0.4"],
    "half_disc": [
        "bodies.disc.nu=0.4999",
        "geometry.mesh_size=0.3",
        "geometry.contact_mesh_size=0.06",
        "steps.count=14",
    ],
    "stick_slip": ["geometry.mesh_size=0.0125", "steps.count=12"],
    "sliding": ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.2", "output.error=false"],
    "half_space": ["geometry.mesh_size=5.0", "geometry.contact_mesh_size=0.1", "steps.count=4"],
}
ALWAYS = ["solver.tolerance=1e-11", "output.pictures=false"]
SAME = 1e-9  # two decades above the tolerance: the answer's condition comes on top
CONDITION = {"cylinders": 30}  # at the edge of contact a pressure is off by 2000 times the tolerance
EXCEPTED = {"estimates", "seconds", "profile", "ranks", "version", "counters"}
# Numbers of one kind are compared at the size of the largest: a force that is 0 by symmetry is a rounding error.
KINDS = {
    "force": ("force", "normal_force", "tangential_force"),
    "moment": ("moment",),
    "stress": ("stress", "max_pressure", "mean_pressure", "max_von_mises"),
    "length": ("displacement", "max_displacement", "max_penetration", "max_slip"),
    "error": ("mesh", "discretisation"),
    "area": ("contact_area", "stick_area", "slip_area"),
    "energy": (
        "external",
        "stored",
        "contact",
        "compliance",
        "dissipated",
        "time_remainder",
        "dissipation",
        "dissipation_total",
    ),
}
KIND = {key: kind for kind, keys in KINDS.items() for key in keys}
DEFECTS = {
    "residual",
    "iteration",
    "equilibrium",
    "rounding",
    "penetration",
    "negative_pressure",
    "cone",
    "complementarity",
}
WORK = ("iterations", "volume_solves")
FEW = 3  # where a step begins with points at their friction bound, rounding decides which of them stick at first
Leaf = tuple[tuple[str, ...], Any]


def leaves(value: Any, path: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """Every number, word and null of result.json with the keys that lead to it."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
    if items is None:
        yield path, value
        return
    for key, item in items:
        yield from leaves(item, (*path, str(key)))


def kind_of(path: tuple[str, ...]) -> str:
    """What a number is: its key, or that of the list it stands in, or of the number whose error it is."""
    if path[-1] == "by":  # a word
        return ""
    if path[0] == "steps" and "error" in path and path[2] != "error":
        path = path[: path.index("error") + 2]
    key = path[-2] if path[-1].isdigit() and len(path) > 1 else path[-1]
    if path[0] not in ("scene", "verdict") and ("audit" in path or key in DEFECTS):
        return "defect"
    return KIND.get(key, "") if path[0] in ("steps", "error") else ""


def compared(result: Any) -> dict[tuple[str, ...], Any]:
    return dict(leaves({key: value for key, value in result.items() if key not in EXCEPTED}))


SEVERAL = """
import json, logging, sys

from stickslip.workflows.commands import cli, start

*others, last = json.loads(sys.argv.pop())
logging.getLogger().addHandler(logging.NullHandler())
with open("/dev/null", "w") as nowhere:
    told, sys.stdout = sys.stdout, sys.stdout if cli.speaks() else nowhere  # as start does
    for words, code in others:
        assert cli.guarded(lambda: cli.app(words, standalone_mode=False)) == code
    sys.stdout = told
sys.argv += last
start.main()
"""


def several(
    ranks: int, first: Iterable[tuple[list[str], int]], last: list[str], folder: Path
) -> subprocess.CompletedProcess[str]:
    """Commands one after the other on the same ranks: to start these takes longer than most runs here.

    Args:
        ranks: their number.
        first: words, and the exit code that each rank is to find.
        last: words of the command that ends the ranks.
        folder: where they work.
    """
    return mpirun(ranks, [json.dumps([*first, last])], folder, ("-c", SEVERAL))


def run_of(name: str, folder: str, words: Iterable[str]) -> list[str]:
    return ["run", name, "-q", "-o", f"{folder}/out", *options([*words, *ALWAYS])]


ALWAYS_RUN = {2: ("block", "two_blocks", "sliding"), 3: ()}
RATES = ["solver.rates=true"]
BLOCKS = ["output.error=false", "solver.method=block-uzawa"]
CUBE = ["geometry.mesh_size=0.25", *ALWAYS, "solver.tolerance=1e-9"]
ITERATIVE = [*CUBE, "output.linear_reference=true", "solver.method=surface-uzawa", "solver.surface=matrix-free"]
ON_TWO = {  # by folder: what always runs on two ranks
    **{f"{name}-2": run_of(name, f"{name}-2", SCENES[name]) for name in ALWAYS_RUN[2]},
    "rates": run_of("block", "rates", [*SCENES["block"], *RATES, *BLOCKS]),
    "iterative": ["run", "cube", "-q", "-o", "iterative/out", *options(ITERATIVE)],
}
RUNS = [  # the others when there is time
    pytest.param((name, ranks), id=f"{name}-{ranks}", marks=[] if name in ALWAYS_RUN[ranks] else pytest.mark.slow)
    for name in SCENES
    for ranks in (2, 3)
]


@pytest.fixture(scope="module", params=RUNS)
def case(request: pytest.FixtureRequest) -> tuple[str, int]:
    """A scene's name, and a number of ranks."""
    found: tuple[str, int] = request.param
    return found


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Results on one rank."""

    @cache
    def results(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name) / "out"
        run(read(name, [*SCENES[name], *ALWAYS]), folder)
        return folder

    return results


@pytest.fixture(scope="module")
def on_two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the folders of `ON_TWO` are."""
    folder = tmp_path_factory.mktemp("on_two")
    for name in ON_TWO:
        (folder / name).mkdir()
    *first, last = ON_TWO.values()
    done = several(2, [(words, 0) for words in first], last, folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


@pytest.fixture(scope="module")
def alone(case: tuple[str, int], known: Callable[[str], Path]) -> tuple[str, Path]:
    """A scene's name, and its results on one rank."""
    return case[0], known(case[0])


@pytest.fixture(scope="module")
def together(
    case: tuple[str, int], tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest
) -> tuple[int, Path]:
    """A number of ranks, and the same scene's results on them."""
    name, ranks = case
    if (kept := f"{name}-{ranks}") in ON_TWO:
        return ranks, request.getfixturevalue("on_two") / kept / "out"
    folder = tmp_path_factory.mktemp(kept)
    done = mpirun(ranks, run_of(name, ".", SCENES[name]), folder)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return ranks, folder / "out"


def test_result_is_that_of_one_rank(alone: tuple[str, Path], together: tuple[int, Path]) -> None:
    one, many = (result(folder) for folder in (alone[1], together[1]))
    assert (one["ranks"], many["ranks"]) == (1, together[0])
    assert many["counters"]["unknowns"] == one["counters"]["unknowns"]
    expected, found = compared(one), compared(many)
    assert found.keys() == expected.keys()
    scale: dict[str, float] = {}
    for path, value in expected.items():
        kind = kind_of(path)
        if kind and value is not None:
            scale[kind] = max(scale.get(kind, 0.0), abs(value))

    def rounding(path: tuple[str, ...]) -> bool:
        """Whether the mesh's part of a number's error is rounding, of which two estimates may differ by anything."""
        mesh = (*path[:-1], "mesh")
        sizes = [(each.get(mesh, np.inf) or 0.0) for each in (expected, found)]
        return max(sizes) <= SAME * scale.get(kind_of(mesh), 0.0)

    for path, value in expected.items():
        kind = kind_of(path)
        if kind == "defect":
            assert (found[path] is None) == (value is None)
            least = value if path[-1] == "moment" else 0.0  # it is of second order in the motion, on any ranks
            assert value is None or max(found[path], value) - least <= SAME, (path, found[path], value)
        elif path[-1] == "unsure" and rounding(path):
            continue
        elif value is None:
            assert found[path] is None, (path, found[path])
        elif kind:
            assert abs(found[path] - value) <= SAME * scale[kind], (path, found[path], value)
        elif path[0] == "neglect":  # shares, of which the smallest are rounding, and values that are reached
            if path[-1] != "seconds" and isinstance(value, float):
                assert_allclose(found[path], value, rtol=SAME, atol=SAME, err_msg=str(path))
            else:
                assert path[-1] == "seconds" or found[path] == value, path
        elif path[-1] in WORK:
            assert abs(found[path] - value) <= FEW, (path, found[path], value)
        else:
            assert found[path] == value, path


def test_fields_are_those_of_one_rank(alone: tuple[str, Path], together: tuple[int, Path]) -> None:
    for index, _ in enumerate(read(alone[0], SCENES[alone[0]]).requested_times(), start=1):
        one, many = (read_step(folder / step_name(index)) for folder in (alone[1], together[1]))
        for key in ("displacement", "stress", "p", "w"):
            expected, found = getattr(one, key), getattr(many, key)
            assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max(), err_msg=key)
        for name, contact in one.contacts.items():
            assert (many.contacts[name].status == contact.status).all()
            assert_allclose(many.contacts[name].weight, contact.weight, rtol=1e-12)


def test_one_set_of_files_is_written(alone: tuple[str, Path], together: tuple[int, Path]) -> None:
    one, many = ({str(path.relative_to(f)) for path in f.rglob("*")} for f in (alone[1], together[1]))
    assert many == one
    assert [path.name for path in together[1].parent.iterdir()] == ["out"]


def test_tables_have_the_rows_of_one_rank_in_its_order(alone: tuple[str, Path], together: tuple[int, Path]) -> None:
    for table in sorted(alone[1].glob("contact_*.csv")):
        one, many = (folder / table.name for folder in (alone[1], together[1]))
        d = read(alone[0]).dim
        places = [[line.split(",")[: 1 + d] for line in path.read_text().splitlines()] for path in (one, many)]
        assert places[0] == places[1]  # time and coordinates, digit by digit


def test_volume_is_solved_by_all_ranks_at_the_price_of_one(alone: tuple[str, Path], together: tuple[int, Path]) -> None:
    one, many = (result(folder)["counters"] for folder in (alone[1], together[1]))
    for counter in ("factorisations", "searches", "schur_size", "forms"):
        assert many[counter] == one[counter]


OUTSIDE, LIES_OUTSIDE = "probes.corner.point=[9.0,9.0]", "probes.corner.point = [9.0, 9.0]: lies outside"
COARSE = ["geometry.mesh_size=4", "geometry.contact_mesh_size=4", 'geometry.cells="tensor"']  # one cell
HELD = ["supports.right={boundary='block.right',displacement={x=0.0,y=0.0}}", ALWAYS[0]]


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("bodies.block.nu=0.6", "bodies.block.nu = 0.6: must lie above -1"),
        ("solver.method=uzava", "did you mean uzawa?"),
        (OUTSIDE, LIES_OUTSIDE),
        ("supports.new={point=[0.123,0.7],displacement={x=0.0}}", "no mesh vertex there"),
    ],
)
@pytest.mark.slow  # below, one that is known from the file and one that is known when meshed, on two ranks
def test_wrong_scene_ends_on_every_rank_with_one_line(override: str, said: str, tmp_path: Path) -> None:
    done = mpirun(3, ["run", "block", "-q", "-o", "out", *options([*SCENES["block"], override])], tmp_path)
    assert done.returncode == 2, done.stderr  # 124: it hung until the time limit
    ours = [line for line in done.stderr.splitlines() if line.startswith("stickslip:")]
    assert len(ours) == 1  # mpirun adds lines of its own
    assert said in ours[0]
    assert "Traceback" not in done.stderr
    assert (done.stdout, list(tmp_path.iterdir())) == ("", [])


@pytest.fixture(scope="module")
def spoken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A run that speaks, a plan, what is refused, a run that does not converge; on two ranks."""
    folder = tmp_path_factory.mktemp("spoken")
    (folder / "foreign").mkdir()
    (folder / "foreign" / "chapter.tex").write_text("years of work")
    block = options(SCENES["block"])
    quick = options([*SCENES["block"], *ALWAYS])
    first = [
        (["run", "block", "-o", "out", *quick, "--set=output.error=false"], 0),
        (["plan", "block", "--mesh", "--json", *block], 0),
        (["run", "block", "-q", "-o", "foreign", *block], 2),
        (["run", "block", "-q", "-o", "outside", *options([*SCENES["block"], OUTSIDE])], 2),
        (["run", "block", "-q", "-o", "one_cell", *options(COARSE)], 2),
        (["run", str(write_hinge(folder)), "-q", "-o", "hinge", *options(HELD)], 2 if dx.OLD else 0),
    ]
    last = ["run", "block", "-q", "-o", "lost", *quick, *options(["solver.method=uzawa", "solver.max_iterations=1"])]
    return folder, several(2, first, last, folder)


def test_foreign_folder_is_refused_on_every_rank(spoken: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = spoken
    assert done.stderr.count("choose another folder with -o") == 1
    assert [path.name for path in (folder / "foreign").iterdir()] == ["chapter.tex"]


def test_what_is_wrong_with_the_mesh_is_said_by_one_rank(spoken: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = spoken
    assert done.stderr.count(LIES_OUTSIDE) == 1
    assert "Traceback" not in done.stderr
    assert not (folder / "outside").exists()


def test_run_without_convergence_ends_on_all_ranks_by_3(spoken: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = spoken
    assert done.returncode == 3, done.stderr
    assert done.stderr.count("stickslip: not converged") == 1
    assert result(folder / "lost")["status"] == "not_converged"


def test_one_rank_speaks(spoken: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    _, done = spoken
    assert done.stdout.count("results in out") == 1
    assert done.stderr.count("t = 2: ") == 1
    told = json.loads(done.stdout[done.stdout.index("{") :])
    assert told["mesh"]["contacts"]["base"]["normal_points"] == 17  # 4 m, 0.25 m a cell


@pytest.mark.slow  # a cell of each method is in test_cells_on_ranks
def test_regularised_finds_on_two_ranks_what_it_finds_on_one(tmp_path: Path) -> None:
    words = [*SCENES["cube"], *ALWAYS, "solver.method=regularised"]
    run(read("cube", words), tmp_path / "one")
    done = mpirun(2, ["run", "cube", "-q", "-o", "two", *options(words)], tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    one, two = (result(tmp_path / name) for name in ("one", "two"))
    assert two["error"]["law"] == pytest.approx(one["error"]["law"], rel=1e-6)  # a difference of two answers
    for mine, other in zip(one["steps"], two["steps"], strict=True):
        forces = [step["contacts"]["base"]["force"] for step in (mine, other)]
        assert_allclose(forces[1], forces[0], atol=SAME * np.abs(forces[0]).max())
        assert other["iterations"] == mine["iterations"]


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("block", RATES),
        pytest.param("foundation", [], marks=pytest.mark.slow),
        pytest.param("block", ["solver.inner_solves=inexact"], marks=pytest.mark.slow),
        pytest.param("cube", ["solver.outer=ksp"], marks=pytest.mark.slow),
        *(pytest.param(name, [], marks=pytest.mark.slow) for name in ("cube", "half_ball", "axisymmetric")),
        *(pytest.param(name, [], marks=pytest.mark.slow) for name in ("two_blocks", "cylinders", "sliding")),
    ],
)
def test_the_block_system_gives_on_two_ranks_what_the_condensed_bodies_give_on_one(
    name: str, more: list[str], tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    words = [*SCENES[name], *ALWAYS, "output.error=false"]
    run(read(name, [*words, "solver.method=condensed-newton"]), tmp_path / "one")
    if more == RATES:
        found = request.getfixturevalue("on_two") / "rates" / "out"
    else:
        done = mpirun(2, run_of(name, "two", [*SCENES[name], *more, *BLOCKS]), tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
        found = tmp_path / "two" / "out"
    steps = result(tmp_path / "one")["steps"]
    for index in range(1, len(steps) + 1):
        one, two = (read_step(folder / step_name(index)) for folder in (tmp_path / "one", found))
        for key in ("displacement", "p", "w"):
            mine, other = getattr(one, key), getattr(two, key)
            allowed = CONDITION.get(name, 10) * SAME * np.abs(mine).max()
            assert_allclose(other, mine, atol=allowed, err_msg=f"step {index}, {key}")


@pytest.mark.parametrize("ranks", [pytest.param(1, marks=pytest.mark.slow), 2, pytest.param(3, marks=pytest.mark.slow)])
def test_iterative_solves_give_on_every_number_of_ranks_what_the_condensed_bodies_give(
    ranks: int, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    run(read("cube", [*CUBE, "output.error=false", "solver.method=condensed-newton"]), tmp_path / "exact")
    exact = result(tmp_path / "exact")
    if ranks == 2:
        folder = request.getfixturevalue("on_two") / "iterative" / "out"
    else:
        folder = tmp_path / "out"
        done = mpirun(ranks, ["run", "cube", "-q", "-o", "out", *options(ITERATIVE)], tmp_path)
        assert (done.returncode, done.stderr) == (0, "")
    found = result(folder)
    assert found["counters"]["linear_iterations"] > 0
    assert found["error"]["linear_solver"] < 1e-9
    total = found["seconds"].pop("total")
    assert found["seconds"]["linear_reference"] > 0
    assert sum(found["seconds"].values()) == pytest.approx(total, rel=1e-9)
    for one, other in zip(exact["steps"], found["steps"], strict=True):
        for contact, state in one["contacts"].items():
            forces = state["force"], other["contacts"][contact]["force"]
            assert_allclose(forces[1], forces[0], atol=1e-6 * np.abs(forces[0]).max())  # tolerance times condition


def test_meshes_that_ranks_cannot_share_are_refused_on_all_of_them(
    spoken: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """One cell for two ranks; and cells that hang together at a point.

    With dolfinx 0.5 each rank would have a node of its own there; later versions share it.
    """
    folder, ended = spoken
    assert ended.stderr.count("the mesh has 1 cells, too few for 2 ranks; use fewer") == 1
    assert not (folder / "one_cell").exists()
    if dx.OLD:
        assert ended.stderr.count("together by points or edges only, where 2 ranks would take them apart") == 1
        assert not (folder / "hinge").exists()
        return
    run(read(str(write_hinge(tmp_path)), HELD), tmp_path / "alone")
    ours, alone = (result(place)["steps"][-1]["energy"]["stored"] for place in (folder / "hinge", tmp_path / "alone"))
    assert_allclose(ours, alone, rtol=SAME)


SAME_CELLS = 1e-8  # three decades above the tolerance: friction's condition, and hundreds of iterations
LIMIT = 600  # s; a rank that waits for the others for ever must not hold up the tests
TURN = 11  # how far the cell of one method lies from that of the next


def sample() -> Iterator[Cell]:
    """One cell of each method, in 2D and, of each second one of them, in 3D; other laws and operators for each."""
    models = cycle(("plane strain", "plane strain", "3d", "3d"))
    for turn, (method, model) in enumerate(zip(METHODS, models, strict=False)):
        cells = [cell for cell in whole(method, model) if cell.friction]
        first = turn * TURN % len(cells)
        yield next(cell for cell in (*cells[first:], *cells[:first]) if refused(cell) is None)


def differences(ranks: int, cells: list[Cell], folder: Path) -> list[str]:
    """A sentence for each cell of which several ranks find something else."""
    asked, found = folder / "cells.json", folder / "found.npz"
    asked.write_text(json.dumps([asdict(cell) for cell in cells]))
    done = mpirun(ranks, [str(asked), str(found)], folder, (on_ranks.__file__,), LIMIT)
    assert done.returncode == 0, done.stderr[-2000:]  # 124: it hung until the time limit
    wrong, many = [], np.load(found)
    for k, cell in enumerate(cells):
        for name, one in on_ranks.answer(solved(cell.scene(on_ranks.TOLERANCE))[1]).items():
            off = np.abs(many[f"{k} {name}"] - one).max() / np.abs(one).max()
            if not off <= SAME_CELLS:
                wrong.append(f"{cell}: {name} {off:.1e} off")
    return wrong


@pytest.mark.parametrize("first", [0, *slow(1)])
def test_each_method_finds_on_two_ranks_what_it_finds_on_one(first: int, tmp_path: Path) -> None:
    assert differences(2, [*sample()][first::2], tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("method", METHODS)
def test_every_cell_finds_on_two_ranks_what_it_finds_on_one(method: str, model: str, tmp_path: Path) -> None:
    """Some of them have two cells of the mesh: there is none for a third rank."""
    cells = [cell for cell in whole(method, model) if refused(cell) is None]
    assert differences(2, cells, tmp_path) == []


TANGENT = """
from stickslip.solvers.interface.prepare import prepare_surface
from stickslip.solvers.tangent.coordinates import ContactCoordinates
simulation = stickslip.prepare(stickslip.read(SCENE, WORDS))
numbers = []
for step in simulation.steps():
    numbers += [step.energy.stored, *(c.normal_force for c in step.contacts.values())]
    numbers += [value for force, moment in step.supports.values() for value in (*force, *moment)]
system = simulation.system
surface = prepare_surface(system, simulation.stepper.chain.volume)
coordinates = ContactCoordinates.of(system, surface)
u, v, again = (system.K_B.createVecRight() for _ in range(3))
low, high = u.getOwnershipRange()
u.array[:] = np.sin(np.arange(low, high))
coordinates.inverse.mult(u, v)
coordinates.T.mult(v, again)
own = np.flatnonzero((coordinates.at >= low) & (coordinates.at < high))
w = (surface.N @ surface.volume.contact.read(u))[own]
wrong = float(max(abs((again - u).array).max(), abs(w - v.array[coordinates.at[own] - low]).max(initial=0.0)))
rows = comm.allreduce(len(own))
assert rows == np.count_nonzero(coordinates.at >= 0), "a row belongs to no rank, or to several"
found = numbers, wrong, len(own), rows
"""
ALWAYS_SURFACE = ["solver.tolerance=1e-11", "output.error=false", 'solver.method="tangent-cg"']
SLAB = ["geometry.mesh_size=0.125", "geometry.height=0.25"]
BALLS = ["geometry.order=1", "geometry.contact_mesh_size=0.1"]
SOFT = ['contacts.base.normal={ law = "compliance", c_n = 20.0, m_n = 1.0 }']
TWO_BLOCKS = "length=1.0, width=1.0, height=1.0, lower_length=2.0, mesh_size=0.25, lower_mesh_size=0.3"
SEARCHED = [
    "model=3d",
    f'geometry={{ builder = "two_blocks", {TWO_BLOCKS} }}',
    "supports.base.displacement={ x = 0.0, y = 0.0, z = 0.0 }",
    "supports.top.displacement={ x = [[0, 0], [1, 0], [2, 0.4]], y = 0.0, z = [[0, 0], [1, -0.02]] }",
    "contacts.joint.sliding=true",
    "contacts.joint.friction.mu=0.1",
    "steps.count=2",
]
CASES = {
    "searched": ("two_blocks", SEARCHED),
    "rigid": ("cube", SLAB),
    "compliant": ("cube", [*SLAB, *SOFT]),
    "mortar": ("spheres", BALLS),
}


QUICK = [("searched", 2)]  # two bodies whose meshes do not match, and rows that change


def coordinates(case: str) -> str:
    scene, words = CASES[case]
    return TANGENT.replace("SCENE", repr(scene)).replace("WORDS", repr([*ALWAYS_SURFACE, *words]))


@pytest.mark.parametrize(
    ("case", "ranks"),
    [
        pytest.param(case, ranks, marks=[] if (case, ranks) in QUICK else pytest.mark.slow)
        for case, ranks in product(CASES, (2, 3))
    ],
)
def test_contact_coordinates_are_shared_by_slave_node(
    case: str, ranks: int, surface_on_two: dict[str, Any], tmp_path: Path
) -> None:
    script = coordinates(case)
    ((alone, _, _, count),) = told(script, 1, tmp_path)
    each = surface_on_two[case] if (case, ranks) in QUICK else told(script, ranks, tmp_path)
    found, wrong, shares, rows = zip(*each, strict=True)
    assert rows[0] == count == sum(shares) > 50
    assert max(wrong) < 1e-12
    assert all(one == found[0] for one in found)
    assert_allclose(found[0], alone, rtol=1e-8, atol=1e-9 * max(map(abs, alone)))


SECANTS = """
from stickslip.solvers import metrics
metrics.SHARED = 0
simulation = stickslip.prepare(stickslip.read("cube", WORDS))
for step in simulation.steps():
    found += [step.energy.stored, step.contacts["base"].tangential_force]
(ready,) = simulation.stepper.chain._ready.values()
found = found, ready.learnt["F"]._S.shape
"""
A_CUBE = ["geometry.mesh_size=0.25", 'solver.method="surface-uzawa"', 'solver.surface="matrix-free"']
LEARNT = SECANTS.replace("WORDS", repr([*A_CUBE, "solver.tolerance=1e-10", "output.error=false"]))


@pytest.fixture(scope="module")
def surface_on_two(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What always runs on two ranks, in one mpirun."""
    scripts = {case: coordinates(case) for case, _ in QUICK} | {"learnt": LEARNT}
    return each_told(scripts, 2, tmp_path_factory.mktemp("on_two"))


@pytest.mark.parametrize("ranks", [2, *slow(3)])
def test_secants_are_shared_by_rows(ranks: int, surface_on_two: dict[str, Any], tmp_path: Path) -> None:
    ((alone, (rows, pairs)),) = told(LEARNT, 1, tmp_path)
    each = surface_on_two["learnt"] if ranks == 2 else told(LEARNT, ranks, tmp_path)
    found, shapes = zip(*each, strict=True)
    assert sum(share for share, _ in shapes) == rows
    assert max(share for share, _ in shapes) <= rows / ranks + 1
    assert all(count == shapes[0][1] > 0 for _, count in shapes)
    assert abs(shapes[0][1] - pairs) <= pairs / 3  # multigrid differs, and with it what volume solves leave
    assert all(one == found[0] for one in found)
    assert_allclose(found[0], alone, rtol=1e-7, atol=1e-9 * max(alone))  # the shear of the first step is zero


MOVED = """
from shared.problems import whole
from stickslip.solvers.system.stiffness import without_rounding
K = whole(stickslip.prepare(stickslip.read("cube", ["geometry.mesh_size=0.125"])).system)
every, u = comm.allreduce(len(K.getValuesCSR()[2])), K.createVecRight()
u.array.reshape(-1, 3)[:] = [1.0, 2.0, 3.0]
found.append((K * u).norm())
K = without_rounding(K)
found += [(K * u).norm(), comm.allreduce(len(K.getValuesCSR()[2])) / every]
"""


@pytest.mark.slow  # in parts on one rank: tests/unit/test_volume.py
def test_bodies_that_move_as_a_whole_feel_no_more_forces(tmp_path: Path) -> None:
    (before, after, share), _ = told(MOVED, 2, tmp_path)
    assert share < 0.75
    assert after < 1.2 * before


WORDS = ["run", "block", "--set=geometry.mesh_size=0.5", "--set=geometry.contact_mesh_size=0.5"]
WORDS += ["--set=output.pictures=false", "--accuracy=base.normal_force=0.3%", "-q"]


def done(ranks: int, words: list[str], folder: Path) -> Any:
    """The result of a command on several ranks, or in this process, which is one."""
    where = folder / f"on_{ranks}"
    if ranks == 1:
        assert guarded(lambda: app([*words, "-o", str(where)], standalone_mode=False)) == 0
    else:
        ended = mpirun(ranks, [*words, "-o", str(where)], folder)
        assert ended.returncode == 0, ended.stderr
    return result(where)


def test_ranks_take_the_same_rounds(tmp_path: Path) -> None:
    rounds = []
    for ranks in (1, 2):
        rounds.append(done(ranks, WORDS, tmp_path)["accuracy"]["rounds"])
    assert len(rounds[0]) > 1
    assert [one["unknowns"] for one in rounds[0]] == [one["unknowns"] for one in rounds[1]]


@pytest.mark.slow  # test_recovered_stress has its siblings on one rank
def test_ranks_state_the_same_errors_of_stress(tmp_path: Path) -> None:
    """Each rank recovers the stress of its own cells, from those of all around its nodes."""
    points = {f"p{i}": {"point": [0.1 + 0.4 * i, 0.45]} for i in range(5)}
    table = ", ".join(f"{name} = {{ point = {probe['point']} }}" for name, probe in points.items())
    words = [*WORDS[:4], "--set=output.pictures=false", f"--set=probes={{ {table} }}", "-q"]
    one, two = (done(ranks, words, tmp_path) for ranks in (1, 2))
    for name in points:
        stated, same = (run["steps"][-1]["probes"][name]["error"]["stress"]["mesh"] for run in (one, two))
        assert max(stated) > 0
        assert same == pytest.approx(stated, rel=1e-6)
    assert two["error"]["discretisation"] == pytest.approx(one["error"]["discretisation"], rel=1e-9)


@pytest.mark.slow  # test_left_out has its siblings on one rank
def test_ranks_state_the_same_errors_of_curved_bodies(tmp_path: Path) -> None:
    words = ["run", "half_disc", "--set=geometry.order=1", "--set=steps.count=1", "--set=output.pictures=false", "-q"]
    one, two = (done(ranks, words, tmp_path)["steps"][-1]["supports"]["top"]["error"]["force"] for ranks in (1, 2))
    assert max(one["geometry"]) > 0
    assert two["geometry"] == pytest.approx(one["geometry"], rel=1e-6)


@pytest.mark.slow  # test_scripts_on_ranks has its sibling in 2D
def test_ranks_state_the_same_errors_of_order_2_in_3d(tmp_path: Path) -> None:
    stated = []
    words = [
        "run",
        "cube",
        "--set=geometry.order=2",
        "--set=geometry.mesh_size=0.5",
        "--set=output.pictures=false",
        "-q",
    ]
    for ranks in (1, 2):
        step = done(ranks, words, tmp_path)["steps"][-1]
        stated.append(step["contacts"]["base"]["error"]["normal_force"]["mesh"])
    assert stated[0] > 0
    assert stated[1] == pytest.approx(stated[0], rel=1e-6)
