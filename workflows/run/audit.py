"""The audit of a run: every step's file is held against equilibrium and the contact laws."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from solvers.results.audit import Audit, Auditor, Record
from solvers.results.step_result import StepResult
from solvers.simulation.simulation import Simulation
from workflows.formats.steps import read_step, step_name
from workflows.run.collective import from_rank_0


def audit_steps(simulation: Simulation, folder: Path, steps: Sequence[StepResult]) -> list[Audit]:
    """One audit a step; collective. Rank 0 alone reads the files: on another machine they may not be there yet.

    The forms it compiles are counted with those of the run.

    Raises:
        MachineError: on every rank: a file cannot be read back.
    """
    if not steps:
        return []
    comm, auditor = simulation.mesh.comm, Auditor(simulation.problem, simulation.mesh)
    audits = []
    for index, step in enumerate(steps, start=1):
        read = partial(_record, folder / step_name(index), step, simulation.mesh.dim)
        audits.append(auditor(from_rank_0(comm, read)))
    simulation.counters.forms += auditor.start.counters.forms
    return audits


def _record(path: Path, step: StepResult, dim: int) -> Record:
    stored = read_step(path)
    return Record(
        time=stored.time,
        displacement=stored.displacement[:, :dim],
        p=stored.p,
        w=stored.w,
        reference=stored.reference,
        driven=stored.driven,
        searched=stored.searched,
        p_ref=stored.p_ref,
        u_ref=stored.u_ref,
        external_work=step.energy.external,
    )
