"""Entries of rounding are left out of the stiffness on several ranks as on one."""

from pathlib import Path

import pytest

from shared.ranks import told

MOVED = """
import json
import numpy as np
from mpi4py import MPI
import stickslip
from shared.matrices import whole
from stickslip.solvers.linear.rounding import without_rounding
comm = MPI.COMM_WORLD
K = whole(stickslip.prepare(stickslip.read("cube", ["geometry.mesh_size=0.125"])).system)
every, found, u = comm.allreduce(len(K.getValuesCSR()[2])), [], K.createVecRight()
u.array.reshape(-1, 3)[:] = [1.0, 2.0, 3.0]
found.append((K * u).norm())
K = without_rounding(K)
found += [(K * u).norm(), comm.allreduce(len(K.getValuesCSR()[2])) / every]
if comm.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.slow  # in parts on one rank: tests/unit/test_volume.py
def test_bodies_that_move_as_a_whole_feel_no_more_forces(tmp_path: Path) -> None:
    before, after, share = told(MOVED, 2, tmp_path)
    assert share < 0.75
    assert after < 1.2 * before
