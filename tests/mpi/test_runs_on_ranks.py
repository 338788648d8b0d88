"""Runs, scripts, sweeps and writers do on several ranks what they do on one."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.cases import slow
from shared.command import COARSE, result, table
from shared.histories import LEARNS, SMALL, Stop
from shared.ranks import each_told, mpirun, told
from stickslip import Watch, read
from stickslip.solvers.linear.multigrid import HYPRE
from stickslip.workflows.formats.steps import read_step, step_name
from stickslip.workflows.run.run import run

# the audit, also of tractions that are wrong
AUDIT = """
from dataclasses import asdict, replace
from shared.audited import record_of
from shared.cells import Cell, solved
from stickslip.solvers.results.audit import Auditor
cells = (Cell("condensed-newton", model="3d", more="order 2"), Cell("condensed-newton", more="sliding"),
         Cell("condensed-newton", model="axisymmetric"), Cell("surface-uzawa", friction="rate_dependent", model="3d"),
         Cell("condensed-newton", "compliance", more="k_T"))
for cell in cells:
    simulation, steps = solved(cell.scene(1e-11), comm)
    audit = Auditor(simulation.problem, simulation.mesh)
    for step in steps:
        record = replace(record_of(step), displacement=comm.bcast(step.displacement))
        right, wrong = (asdict(audit(each)) for each in (record, replace(record, p=1.01 * record.p)))
        found.append([max(right.values()), wrong["equilibrium"]])
"""

# springs, bolts and remote points, in both forms of the bodies
COUPLINGS = """
words = [
    "springs.side={at='block.left',to='block.right',stiffness=[0.2,0.1]}",
    "springs.tip={at=[4.0,2.0],stiffness=0.3,direction=[1.0,1.0],displacement=[0.05,0.0]}",
    "springs.stop={at='block.top',stiffness=0.2,direction=[0.0,1.0],acts='compression',gap=0.005}",
    "springs.slack={at=[4.0,0.0],stiffness=0.2,direction=[1.0,0.0],acts='compression'}",
    "geometry={builder='block',length=4.0,height=2.0,mesh_size=1.0,order=ORDER}",
    "solver={method='surface-uzawa',surface='FORM',tolerance=1e-10}",
    "steps={end=2.0,count=2}",
    "supports.top={boundary='block.left',displacement={x=[[0.0,0.0],[1.0,0.01]]}}",
    "remote_points.lid={boundary='block.top',point=[1.0,5.0],coupling='rigid',force={y=-0.1,x=0.05},moment={z=0.02}}",
    "bolts.tie={head='block.right',nut='block.left',axis=[1.0,0.0],stiffness=0.05,shortening=0.02}",
    "remote_points.end={boundary='block.left',point=[0.0,1.5],coupling='distributing',moment={z=0.01}}",
]
for form, order in (("condensed", 2), ("matrix-free", 1)):
    own = [word.replace("ORDER", str(order)).replace("FORM", form) for word in words]
    simulation = stickslip.prepare(stickslip.read("block", own))
    *_, step = simulation.steps()
    numbers = [x for kind in (step.springs, step.remote_points) for each in kind.values() for x in each]
    numbers += [*step.bolts.values()]
    found.append([*(float(x) for values in numbers for x in values), step.energy.stored])
"""

# errors of the mesh with order 2
ORDER_2 = """
sizes = ["geometry.mesh_size=0.3", "geometry.contact_mesh_size=0.15"]
simulation = stickslip.prepare(stickslip.read("block", ["geometry.order=2", "solver.tolerance=1e-11", *sizes]))
for step in simulation.mesh_errors([*simulation.steps()]):
    found.append([float(x) for parts in step.values() if parts.mesh is not None for x in np.ravel(parts.mesh)])
"""

# orthotropic bodies and their errors
ORTHOTROPIC = """
from stickslip.solvers.results.step_result import Quantity
words = ["geometry.mesh_size=0.02", "steps.count=3", "solver.tolerance=1e-11"]
for order in (1, 2):
    simulation = stickslip.prepare(stickslip.read("spruce", [*words, f"geometry.order={order}"]))
    steps = [*simulation.steps()]
    errors = simulation.errors(steps)
    for step, error in zip(steps, errors):
        base = step.contacts["base"]
        found += [base.normal_force, base.tangential_force, base.stick_area, step.energy.stored]
        found += [error[Quantity("contacts", "base", key)].mesh for key in ("tangential_force", "dissipation")]
found = [float(value) for value in found]
"""

# a history that reads contacts, decides on every rank alike, and goes on
SCRIPTED = """
scene = stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.25", "solver.tolerance=1e-11"])
script, x = stickslip.prepare(scene).script(), 0.0
step = script.step(to=1.0)
while step.contacts["base"].slip_area < step.contacts["base"].contact_area and x < 0.2:
    x += 0.03
    step = script.step(to=script.time + 1.0, supports={"top": {"x": x}})
    base = step.contacts["base"]
    found.append([x, *base.force, base.stick_area, *step.energy.dissipation, *step.supports["top"][0]])
assert comm.rank or len(step.displacement) > 0
"""

# a factor with pressures as unknowns: no pivot that is not counted
RUBBER = """
words = ["bodies.block.nu=0.499", "geometry.order=2", "solver.tolerance=1e-11", 'solver.surface="condensed"']
simulation = stickslip.prepare(stickslip.read("cube", [*words, "geometry.mesh_size=SIZE", "output.error=false"]))
for step in simulation.steps():
    base = step.contacts["base"]
    found += [base.normal_force, base.stick_area, base.max_pressure, step.energy.stored]
found = [float(value) for value in found]
"""

# multigrid of tetrahedra: cuts between ranks run through cells of a layer like a comb
MULTIGRID = """
from stickslip.solvers.results.linear_reference import linear_reference
simulation = stickslip.prepare(stickslip.read("cube", ['geometry.cells="simplex"', "geometry.mesh_size=0.07"]))
found = linear_reference(simulation.system, "cg+boomeramg").solvers["cg+boomeramg"]
found = [found.iterations, found.residual]
"""
# a round of order 2 that is of no use: rank 0 alone has the sizes of its mesh
LOWERED = """
from stickslip.geometry.mesh_sizes import SizeField
from stickslip.workflows.accuracy.level import Level
from stickslip.workflows.accuracy.rounds import _lowered
sizes = SizeField(points=np.eye(3, 2), cells=np.array([[0, 1, 2]]), sizes=np.ones(3))
for field in (None, sizes if comm.rank == 0 else None):
    found.append(_lowered(Level(order=2, factor=0.5, sizes=field), comm).factor)
"""
# bodies that come near in the third step
MEETING = """
import tempfile
from pathlib import Path
from shared.travel import travel
from stickslip.workflows.scene_file.read import from_dict
folder = Path(comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else ""))
if comm.rank == 0:
    travel(folder)
comm.Barrier()
contacts = {"any": {"between": "all", "sliding": True, "friction": {"law": "coulomb", "mu": 0.2}}}
simulation = stickslip.prepare(from_dict(travel(folder, contacts=contacts), folder))
for step in simulation.steps():
    found.append([float(step.contacts[name].normal_force) for name in simulation.scene.pairs])
found.append([simulation.counters.added_dofs, simulation.counters.factorisations])
"""
# a side on three rollers as it slides, and a pair found there; with a law at points between nodes too
PARTNERS = """
from stickslip.workflows.scene_file.read import from_dict
rollers = {f"at_{x}": {"shape": "cylinder", "point": [x, -1.0], "radius": 1.0} for x in (2, 5, 8)}
floor = {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}}
for normal, given in (({"law": "unilateral"}, rollers), ({"law": "compliance", "c_n": 1e4}, floor | rollers)):
    scene = {
        "model": "plane strain",
        "geometry": {"builder": "block", "length": 10.0, "height": 1.0, "mesh_size": 0.5},
        "bodies": {"block": {"E": 1e4, "nu": 0.3}},
        "obstacles": given,
        "contacts": {"bed": {"surface": "block.bottom", "against": [*given], "sliding": True, "normal": normal,
                             "friction": {"law": "coulomb", "mu": 0.1}}},
        "supports": {"top": {"boundary": "block.top", "displacement": {"x": [[0, 0], [1, 0], [2, 0.7]], "y": -0.01}}},
        "steps": {"end": 2.0, "count": 2},
        "solver": {"tolerance": 1e-11},
    }
    for step in stickslip.prepare(from_dict(scene)).steps():
        for contact in (*step.contacts.values(), *step.sums.values()):
            found.append([float(x) for x in (*contact.force, contact.normal_force, contact.contact_area)])
"""
# a quarter of a press fit that slides past its cut, on nodes that another rank may own
SECTORS = """
from stickslip.workflows.scene_file.read import from_dict
cut = {body: {"boundary": f"{body}.y_axis", "with": f"{body}.x_axis", "angle": 90.0} for body in ("inner", "outer")}
scene = {
    "model": "plane strain",
    "geometry": {"builder": "rings", "inner_radius": 0.5, "radius": 1.0, "outer_radius": 2.0, "interference": 0.02,
                 "angle": 90, "mesh_size": 0.25, "inner_mesh_size": 0.19},
    "bodies": {"inner": {"E": 1.0, "nu": 0.3}, "outer": {"E": 2.0, "nu": 0.2}},
    "contacts": {"fit": {"surface": "outer.inside", "against": "inner.outside", "sliding": True,
                         "friction": {"law": "coulomb", "mu": 0.1}}},
    "supports": {"rim": {"boundary": "outer.outside", "displacement": {"x": "-0.1*y*t", "y": "0.1*x*t"}}},
    "elastic_support": {"bed": {"boundary": "inner.inside", "tangential": 5.0}},
    "periodic": cut,
    "solver": {"tolerance": 1e-11},
}
for step in stickslip.prepare(from_dict(scene)).steps():
    fit = step.contacts["fit"]
    found += [float(x) for x in (*fit.force, *fit.moment, fit.normal_force, fit.max_pressure, step.energy.stored)]
"""
SIZE = "0.2"  # MUMPS divides the last front among ranks, where it may
SCRIPTS = {
    "audit": AUDIT,
    "couplings": COUPLINGS,
    "order 2": ORDER_2,
    "orthotropic": ORTHOTROPIC,
    "scripted": SCRIPTED,
    "rubber": RUBBER.replace("SIZE", SIZE),
    "multigrid": MULTIGRID,
    "lowered": LOWERED,
    "meeting": MEETING,
    "partners": PARTNERS,
    "sectors": SECTORS,
}
Both = dict[str, tuple[Any, Any]]


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Both:
    """By script, what one rank finds, and both of two."""
    folder = tmp_path_factory.mktemp("scripts")
    alone, together = (each_told(SCRIPTS, ranks, folder) for ranks in (1, 2))
    found = {}
    for name in SCRIPTS:
        (one, other) = together[name]
        assert one == other, name
        found[name] = (*alone[name], one)
    return found


def test_two_ranks_audit_as_one_does(both: Both) -> None:
    alone, one = both["audit"]
    assert len(alone) == len(one) == 10
    assert max(defect for step in (*alone, *one) for defect in step[:1]) < 1e-9  # the solver's tolerance is 1e-11
    wrong = [[step[1] for step in steps] for steps in (alone, one)]
    assert min(wrong[0]) > 1e-6
    assert_allclose(wrong[1], wrong[0], rtol=1e-7)


def test_ranks_agree_on_forces_and_motions_of_couplings(both: Both) -> None:
    alone, one = both["couplings"]
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9)


def test_ranks_find_the_errors_of_order_2(both: Both) -> None:
    alone, one = both["order 2"]
    assert np.shape(alone) == np.shape(one) == (2, len(alone[0]))
    assert np.min(alone) >= 0
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9 * np.max(alone))


def test_ranks_agree_on_forces_and_errors_of_orthotropic_bodies(both: Both) -> None:
    alone, one = both["orthotropic"]
    assert_allclose(one, alone, rtol=1e-6, atol=1e-9 * max(alone))


def test_ranks_decide_alike_and_have_the_answer_of_one(both: Both) -> None:
    alone, one = both["scripted"]
    assert len(alone) == len(one) == 5  # slips as a whole at x = 0.15
    assert_allclose(one, alone, rtol=0, atol=1e-9 * np.abs(alone).max())  # two decades above the solver's tolerance


def test_ranks_agree_on_nearly_incompressible_bodies(both: Both) -> None:
    alone, one = both["rubber"]
    assert_allclose(one, alone, rtol=1e-8)


@pytest.mark.skipif(not HYPRE, reason="GAMG smooths by Chebyshev polynomials, which know no ranks")
def test_multigrid_converges_however_cells_are_shared(both: Both) -> None:
    (iterations, residual), (of_two, left) = both["multigrid"]
    assert max(residual, left) <= 1e-8
    assert of_two <= 1.25 * iterations


def test_ranks_find_pairs_as_bodies_come_near(both: Both) -> None:
    alone, one = both["meeting"]
    assert_allclose(np.concatenate(one), np.concatenate(alone), rtol=1e-9, atol=1e-12)
    assert alone[2][0] > 0.07


def test_ranks_share_a_side_among_the_same_partners(both: Both) -> None:
    alone, one = both["partners"]
    assert_allclose(one, alone, rtol=1e-8, atol=1e-8 * np.max(np.abs(alone[0])))


def test_ranks_slide_past_the_same_cut(both: Both) -> None:
    alone, one = both["sectors"]
    assert min(map(abs, alone)) > 0
    assert_allclose(one, alone, rtol=1e-8)


def test_ranks_halve_the_same_mesh_sizes(both: Both) -> None:
    alone, one = both["lowered"]
    assert one == alone == [0.25, 0.5]


@pytest.mark.parametrize("size", slow(0.25))
def test_ranks_agree_on_nearly_incompressible_bodies_of_other_sizes(size: float, tmp_path: Path) -> None:
    (alone,), (one, other) = (told(RUBBER.replace("SIZE", str(size)), ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert_allclose(one, alone, rtol=1e-8)


EXACT = "solver.tolerance=1e-12"
SAME = 1e-10  # relative: the residual of either run is relative to p_ref, the answer's condition comes on top
SCENES = {
    "block": [*SMALL, "steps.count=4", "output.error=false"],
    "cube": ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4", *LEARNS],
    "sliding": ["geometry.mesh_size=0.25", "geometry.lower_mesh_size=0.2", "output.pictures=false", "steps.end=1.5"],
    "stack": ["geometry.mesh_size=0.25", "output.pictures=false", "steps.count=4"],
    "stick_slip": ["geometry.mesh_size=0.0125", "output.pictures=false", "steps.count=8"],
}
ON_RANKS = """
import sys
from shared.histories import Stop
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read

outcome, _ = run(read(sys.argv[1], sys.argv[2:]), "out", Watch(on_step=Stop(2)), resume=True)
sys.exit(outcome.exit_code)
"""  # the signal comes to rank 0 alone


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n != "block")) for n in SCENES])
def test_it_goes_on_to_the_same_answer_on_two_ranks_and_on_one(name: str, tmp_path: Path) -> None:
    words = [*SCENES[name], EXACT]
    scene = read(name, words)
    times = scene.requested_times()
    run(scene, tmp_path / "whole")
    run(scene, tmp_path / "out", Watch(on_step=Stop(1)))
    done = mpirun(2, [name, *words], tmp_path, ("-c", ON_RANKS))
    assert done.returncode == 128 + signal.SIGINT, done.stderr
    assert result(tmp_path / "out")["status"] == "interrupted"
    outcome, _ = run(scene, tmp_path / "out", resume=True)
    assert outcome.status == "converged"
    log = (tmp_path / "out" / "run.log").read_text()
    assert log.count("resumed after step 1,") == log.count("resumed after step 3,") == 1
    for index in range(1, len(times) + 1):
        ours, theirs = (read_step(tmp_path / folder / step_name(index)) for folder in ("out", "whole"))
        assert ours.time == theirs.time == times[index - 1]
        for key in ("displacement", "p", "w"):
            expected, found = getattr(theirs, key), getattr(ours, key)
            assert_allclose(found, expected, rtol=0, atol=SAME * np.abs(expected).max(initial=0.0), err_msg=key)
    ours, theirs = (result(tmp_path / folder) for folder in ("out", "whole"))
    totals = [[step["energy"][key] for step in steps["steps"]] for steps in (ours, theirs) for key in ("external",)]
    assert_allclose(totals[0], totals[1], rtol=SAME)


ON_THE_SAME_RANKS = """
import errno
import os
import shutil
import sys
from pathlib import Path

from mpi4py import MPI

from stickslip.geometry.errors import MachineError
from shared.histories import Stop, assert_same
from stickslip.workflows.run.run import run
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.formats.serialised import PlainFile

comm, scene = MPI.COMM_WORLD, read(sys.argv[1], sys.argv[2:])
run(scene, "whole")
run(scene, "out", Watch(on_step=Stop(1)))
comm.Barrier()
assert len(os.listdir("out/learnt")) == 2  # of two ranks
if comm.rank == 0:
    shutil.copytree("out", "damaged", symlinks=True)
    os.truncate("damaged/learnt/000001.1.bin", 100)
comm.Barrier()
write = PlainFile.write


def full(file, path):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


if comm.rank == 1:
    PlainFile.write = full
try:
    run(scene, "out", resume=True)
except MachineError as error:
    assert "000002.1.bin: No space left on device; 1 steps are kept" in str(error), error
else:
    raise AssertionError(f"rank {comm.rank} goes on")
PlainFile.write = write
notes = []
assert run(scene, "damaged", Watch(on_note=notes.append), resume=True)[0].status == "converged"
assert [note.partition(":")[0] for note in notes] == ["what the method had learnt is lost"] * (comm.rank == 0), notes
run(scene, "out", resume=True)
if comm.rank == 0:
    assert_same(Path("out"), Path("whole"))
"""


def test_each_rank_keeps_what_it_has_learnt_and_all_fail_or_none(tmp_path: Path) -> None:
    words = [*SMALL, *LEARNS, "steps.count=2", "output.error=false"]
    done = mpirun(2, ["block", *words], tmp_path, ("-c", ON_THE_SAME_RANKS))
    assert done.returncode == 0, done.stderr


BY_WRITERS = """
import sys
from pathlib import Path

from stickslip.geometry.errors import MachineError
from stickslip.workflows.run.run import run
from stickslip.workflows.scene_file.read import read
from stickslip.workflows.writers.writer import Writer


class Alone(Writer):
    def resume(self, steps):
        pass

    def step(self, index, result):
        Path(f"alone.{self.job.comm.rank}").touch()


class Together(Writer):
    collective = True
    full = False

    def resume(self, steps):
        pass

    def step(self, index, result):
        assert self.job.comm.allreduce(1) == 2
        Path(f"together.{self.job.comm.rank}").touch()
        if self.full and self.job.comm.rank == 1:
            raise MachineError("no room on rank 1")


scene = read("block", sys.argv[1:])
run(scene, "out")
Together.full = True
try:
    run(scene, "other")
except MachineError as error:
    assert "no room on rank 1; 1 steps are kept" in str(error), error
else:
    raise AssertionError("goes on")
"""


def test_a_writer_is_called_on_the_ranks_that_it_asks_for(tmp_path: Path) -> None:
    done = mpirun(2, [*SMALL, "steps.count=2", "output.error=false"], tmp_path, ("-c", BY_WRITERS))
    assert done.returncode == 0, done.stderr
    names = {path.name for path in tmp_path.iterdir() if path.is_file()}
    assert names == {"alone.0", "together.0", "together.1"}


def test_ranks_are_the_workers(tmp_path: Path) -> None:
    words = ["sweep", "block", *COARSE, "contacts.base.friction.mu=[0.1, 0.3]", "-o", "out"]
    ended = mpirun(3, words, tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert sorted(line.split()[0] for line in ended.stdout.splitlines() if "converged" in line) == ["1/2", "2/2"]
    assert len(table(tmp_path / "out" / "sweep.csv")) == 2
    assert result(tmp_path / "out" / "mu=0.3")["ranks"] == 1
