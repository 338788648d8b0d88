"""The audit on several ranks finds what it finds on one, also of tractions that are wrong."""

from pathlib import Path

from numpy.testing import assert_allclose

from shared.ranks import told

SCRIPT = """
import json
from dataclasses import asdict, replace
from mpi4py import MPI
from shared.audited import record_of
from shared.cells import Cell, solved
from stickslip.solvers.results.audit import Auditor
comm, told = MPI.COMM_WORLD, []
cells = (Cell("condensed-newton", model="3d", more="order 2"), Cell("condensed-newton", more="sliding"),
         Cell("condensed-newton", model="axisymmetric"), Cell("condensed-newton", "compliance", more="k_T"))
for cell in cells:
    simulation, steps = solved(cell.scene(1e-11), comm)
    audit = Auditor(simulation.problem, simulation.mesh)
    for step in steps:
        record = replace(record_of(step), displacement=comm.bcast(step.displacement))
        found = [asdict(audit(each)) for each in (record, replace(record, p=1.01 * record.p))]
        told.append([max(found[0].values()), found[1]["equilibrium"]])
everywhere = comm.gather(told)
if comm.rank == 0:
    print(json.dumps(everywhere))
"""


def test_two_ranks_audit_as_one_does(tmp_path: Path) -> None:
    (alone,), (one, other) = (told(SCRIPT, ranks, tmp_path) for ranks in (1, 2))
    assert one == other
    assert len(alone) == len(one) == 8
    assert max(defect for step in (*alone, *one) for defect in step[:1]) < 1e-9  # the solver's tolerance is 1e-11
    wrong = [[step[1] for step in steps] for steps in (alone, one)]
    assert min(wrong[0]) > 1e-6
    assert_allclose(wrong[1], wrong[0], rtol=1e-7)
