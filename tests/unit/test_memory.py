"""Memory is foretold from the mesh and compared with what the machine and its groups have left."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from mpi4py import MPI

import stickslip.solvers.simulation.memory
import stickslip.workflows.run.mesh_report
from stickslip.geometry.errors import MachineError
from stickslip.geometry.memory import available
from stickslip.geometry.protocols import Comm
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.simulation.memory import (
    ERRORS,
    PICTURES,
    PRICES,
    STAGES,
    SURE,
    Counts,
    Demand,
    Part,
    affordable,
    foretold,
    least_available,
    memory_of,
)
from stickslip.solvers.stepping.choice import ENTRIES, Choice, Size, Stage
from stickslip.workflows.lab.benchmarks.memory import measure
from stickslip.workflows.lab.benchmarks.own_process import apart
from stickslip.workflows.run.mesh_report import look
from stickslip.workflows.scene_file.read import read

GIB = 2**30


def machine(root: Path, files: dict[str, str], gib: int = 16) -> Path:
    """A root folder with so much memory available, and other files."""
    told = {"proc/meminfo": f"MemTotal: 1 kB\nMemAvailable: {gib * 2**20} kB\n"}
    for name, text in (told | files).items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


def test_this_machine_has_memory_left_and_no_more_than_it_has() -> None:
    lines = Path("/proc/meminfo").read_text().splitlines()
    total = next(int(line.split()[1]) for line in lines if line.startswith("MemTotal:"))
    assert 2**20 < available() < 1024 * total


def test_without_groups_the_machine_counts(tmp_path: Path) -> None:
    assert available(machine(tmp_path, {})) == 16 * GIB


def test_where_nothing_is_told_memory_is_without_limit(tmp_path: Path) -> None:
    assert available(tmp_path) == 2**63


@pytest.mark.parametrize(
    ("line", "folder", "limit", "used", "cache"),
    [
        ("0::/box/run", "sys/fs/cgroup", "memory.max", "memory.current", "inactive_file"),
        ("4:memory:/box/run", "sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes",
         "total_inactive_file"),
    ],
)  # fmt: skip
def test_the_tightest_group_counts(tmp_path: Path, line: str, folder: str, limit: str, used: str, cache: str) -> None:
    groups = {
        "proc/self/cgroup": f"9:name=systemd:/elsewhere\n{line}\n",
        f"{folder}/box/{limit}": f"{4 * GIB}\n",
        f"{folder}/box/{used}": f"{3 * GIB}\n",
        f"{folder}/box/memory.stat": f"anon 7\n{cache} {GIB // 2}\n",
    }
    inner = {f"{folder}/box/run/{limit}": "max\n"}  # no limit of its own
    root = machine(tmp_path, groups | inner)
    assert available(root) == 3 * GIB // 2  # 4 - 3, and half a GiB of files that are only cached
    (root / f"{folder}/box/{used}").write_text(f"{5 * GIB}\n")
    assert available(root) == 0
    (root / f"{folder}/box/{limit}").write_text(f"{64 * GIB}\n")
    assert available(root) == 16 * GIB  # a group may be promised more than there is


def test_a_group_that_is_not_seen_under_its_name_is_the_one_that_is_seen(tmp_path: Path) -> None:
    hidden = {
        "proc/self/cgroup": "0::/outside/of/this/box\n",
        "sys/fs/cgroup/memory.max": f"{2 * GIB}\n",
        "sys/fs/cgroup/memory.current": f"{GIB}\n",
    }
    assert available(machine(tmp_path, hidden)) == GIB


FACTOR = 1.4  # the peak that is foretold is that of the process within this factor, either way
GB = 1e9


@pytest.fixture
def scene() -> Scene:
    return read("cube")


def demand_of(scene: Scene, size: Size, form: str = "matrix-free") -> Demand:
    stage = Stage("tangent-cg" if form == "matrix-free" else "condensed-newton", form)
    return memory_of(scene.output, Counts("hexahedron", 1, size.dofs / 3, size.ranks), size, Choice((stage,), ""))


def cube(unknowns: int, ranks: int = 1) -> Size:
    side = round((unknowns / 3) ** (2 / 3))
    return Size(3, unknowns, 81.0 * unknowns, 3 * side, ranks=ranks)


def test_every_kind_of_cell_has_its_prices() -> None:
    assert set(PRICES) == set(ENTRIES)
    assert all(min(vars(price).values()) >= 0 for price in PRICES.values())


def test_ranks_choose_by_the_least_memory_of_them_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the run does; else one would refuse a scene while the others wait for it."""

    class Other(SimpleNamespace):
        """Of two ranks, whose second has nearly no memory."""

        def allreduce(self, value: float, op: MPI.Op) -> float:
            assert op == MPI.MIN
            return min(value, 1e4)

    assert least_available(cast(Comm, Other())) == 1e4
    small = read("cube", ["geometry.mesh_size=0.5"])
    assert look(small)[1].stages[0].surface == "condensed"
    asked = list[Comm]()
    for place in (stickslip.solvers.simulation.memory, stickslip.workflows.run.mesh_report):
        monkeypatch.setattr(place, "least_available", lambda comm: asked.append(comm) or 1e4)
    assert look(small)[1].stages[0].surface == "matrix-free"
    names = [part["part"] for part in cast(list[dict[str, str]], (foretold(small) or {})["parts"])]
    assert "multigrid" in names
    assert len(asked) == 2


def test_the_peak_is_that_of_the_stage_with_most_in_it() -> None:
    parts = (Part("a", 2.0, 1.0, ("solving", "end")), Part("b", 4.0, 0.0, ("solving",)), Part("c", 0.0, 5.0, ("end",)))
    found = Demand(parts, 1, 2)
    assert found.stages == {"meshing": 0.0, "assembling": 0.0, "solving": 7.0, "end": 8.0}
    assert found.peak == 8.0
    assert found.machine == 13.0  # two ranks in solving, 2 (2 + 4) + 1, take more than at the end, 2 * 2 + 1 + 5


def test_ranks_share_the_bodies_and_a_part_of_contact(scene: Scene) -> None:
    one, four = ({p.name: p for p in demand_of(scene, cube(3_000_000, n)).parts} for n in (1, 4))
    assert four["stiffness"].rank == pytest.approx(one["stiffness"].rank / 4)
    assert four["multigrid"].rank == pytest.approx(one["multigrid"].rank / 4)
    assert one["contact"].rank / 4 < four["contact"].rank < one["contact"].rank


def test_what_a_scene_leaves_out_takes_nothing(scene: Scene) -> None:
    quiet = replace(scene, output=replace(scene.output, error=False, pictures=False, audit=False))
    every, few = ({part.name for part in demand_of(each, cube(10**6)).parts} for each in (scene, quiet))
    assert every - few == {"error estimate", "pictures"}
    assert few < every


def test_the_condensed_form_takes_what_its_choice_foretells(scene: Scene) -> None:
    size = cube(30_000)
    parts = {part.name: part for part in demand_of(scene, size, "condensed").parts}
    assert parts["factor, dense stiffness"].rank == size.dense_bytes
    assert "multigrid" not in parts


def test_what_fits_is_left_as_it_is(scene: Scene) -> None:
    demand = demand_of(scene, cube(10**6))
    assert affordable(scene.output, demand, demand.machine, steered=False) == (scene.output, "")


def test_errors_that_do_not_fit_are_left_out_and_it_is_said(scene: Scene) -> None:
    demand = demand_of(scene, cube(10**6))
    free = (demand.machine + demand.without(ERRORS).machine) / 2
    wanted, said = affordable(scene.output, demand, free, steered=False)
    assert not wanted.error
    assert "errors are not estimated" in said
    assert f"{free / GB:.2g} GB are free" in said


def test_errors_that_decide_how_a_run_goes_on_are_not_left_out(scene: Scene) -> None:
    demand = demand_of(scene, cube(10**6))
    wanted, said = affordable(scene.output, demand, demand.machine / (1 + SURE) * 2, steered=True)
    assert wanted.error
    assert "may be ended by the system" in said


def test_a_run_that_does_not_fit_is_refused_with_what_to_set(scene: Scene) -> None:
    with pytest.raises(MachineError, match=r"1 GB are free; use a larger mesh_size, or more machines"):
        affordable(scene.output, demand_of(scene, cube(10**7)), 1 * GB, steered=False)


def test_what_would_not_help_is_not_proposed(scene: Scene) -> None:
    few = Demand((Part("mesh", 2 * GB, 0.0, STAGES), Part(PICTURES, 2 * GB, 0.0, ("end",))), 1, 1)
    with pytest.raises(MachineError, match=r"2 GB are free; use output.pictures = false, a larger mesh_size"):
        affordable(scene.output, few, 2 * GB, steered=False)
    with pytest.raises(MachineError, match=r"1 GB are free; use a larger mesh_size"):
        affordable(scene.output, few, 1 * GB, steered=False)


def test_without_a_mesh_the_expected_number_of_cells_counts() -> None:
    coarse, fine = (foretold(read("cube", [f"geometry.mesh_size={size}"])) for size in (0.05, 0.025))
    assert coarse is not None
    assert fine is not None
    assert 5 < part(fine, "stiffness") / part(coarse, "stiffness") < 9  # eight times as many cells


def test_averaged_dilatations_take_more_where_they_are_one_matrix(scene: Scene) -> None:
    plain = cube(30_000)
    rubber = replace(plain, entries=1526.0 * plain.dofs, mixed=3.0)
    free, condensed, before = (
        {part.name: part.rank for part in demand_of(scene, size, form).parts}
        for size, form in ((rubber, "matrix-free"), (rubber, "condensed"), (plain, "condensed"))
    )
    assert condensed["stiffness"] < 5 * before["stiffness"]
    assert condensed["factor, dense stiffness"] > before["factor, dense stiffness"]
    assert "averages of the dilatation" not in condensed
    assert free["averages of the dilatation"] > free["stiffness"] > 10 * before["stiffness"]


def part(memory: dict[str, object], name: str) -> float:
    parts = memory["parts"]
    assert isinstance(parts, list)
    return float(next(each["rank"] for each in parts if each["part"] == name))


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(
            ("cube", "geometry.mesh_size=0.0625", 'solver={ method = "tangent-cg", surface = "matrix-free" }'),
            id="cube with errors",
        ),
        pytest.param(
            ("cube", "geometry.mesh_size=0.04", "output.error=false", 'solver={ method = "tangent-cg" }'),
            id="finer cube without",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            ("block", "geometry.mesh_size=0.02", "geometry.contact_mesh_size=0.02", "output.error=false"),
            id="block",
            marks=pytest.mark.slow,
        ),
        pytest.param(  # condensed
            ("cube", "geometry.mesh_size=0.125", "bodies.block.nu=0.499", "geometry.order=2", "output.error=false"),
            id="rubber",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_the_peak_of_a_run_is_the_one_that_was_foretold(case: tuple[str, ...]) -> None:
    """In a process of its own: its peak is counted from the beginning."""
    scene, *override = case
    found = apart(measure, scene, override)
    measured, expected = max(found["stages"].values()), max(found["predicted"].values())
    assert 1 / FACTOR < expected / measured < FACTOR
