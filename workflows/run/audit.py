"""The audit of a run: every step's file is held against equilibrium and the contact laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from stickslip.solvers.results.audit import Audit, Auditor
from stickslip.solvers.results.step_result import Errors, StepResult, told
from stickslip.solvers.results.stored_fields import Record, StoredFields
from stickslip.solvers.results.verdict import passed
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.workflows.formats.steps import light_name, read_step, step_name
from stickslip.workflows.run.ranks import from_rank_0
from stickslip.workflows.run.written_files import WrittenFiles


@dataclass(frozen=True, kw_only=True)
class Audited:
    """The audits of a run, and what they could not judge by a formula of their own."""

    # one a step, None if its fields are not stored; or none where the run was stopped or the scene leaves the audit out
    audits: tuple[Audit | None, ...] = ()
    shared: tuple[str, ...] = ()  # see `Auditor.shared`
    passed: tuple[str, ...] = ()  # sentences on the numbers that pass their limits
    files: WrittenFiles | None = None  # what the tables of contacts tell; on rank 0


def audit_steps(simulation: Simulation, folder: Path, steps: Sequence[StepResult]) -> Audited:
    """One audit a step whose fields are stored; collective. Rank 0 alone reads the files: elsewhere they may lag.

    The forms it compiles are counted with those of the run.

    Raises:
        MachineError: on every rank: a file cannot be read back.
    """
    if not steps:
        return Audited()
    comm, auditor = simulation.mesh.comm, Auditor(simulation.problem, simulation.mesh)
    files = WrittenFiles(simulation, folder) if comm.rank == 0 else None
    audits, before, told_before = list[Audit | None](), None, dict[str, Any]()
    for index, step in enumerate(simulation.clock.counted(steps), start=1):
        record = from_rank_0(comm, partial(_record, folder, index, simulation.mesh.dim, step.time, files))
        now = told(step, None)
        if record is not None:
            moments = {name: np.array(each["moment"]) for name, each in now["contacts"].items()}
            stored = replace(
                record.stored, moments=moments, told=now, told_before=told_before, law_error=step.law_error
            )
            record = replace(record, stored=stored)
        told_before = now
        audits.append(None if record is None else auditor(record, before if step.substeps == 1 else None))
        before = record
    simulation.counters.forms += auditor.start.counters.forms
    shared = (*auditor.shared, *["sensitivity: derivatives"] * (simulation.slopes is not None))
    return replace(_judged(simulation, steps, audits, shared), files=files)


def audit_files(
    simulation: Simulation, folder: Path, steps: Sequence[StepResult], errors: Sequence[Errors] | None, audited: Audited
) -> Audited:
    """The audits with what tables and XDMF files tell, once they are all written; collective.

    What is told wrong of a step without fields counts with the next one that has them.

    Raises:
        MachineError: on every rank: a file cannot be read back.
    """
    off = from_rank_0(simulation.mesh.comm, lambda: audited.files and audited.files.apart(steps, errors)) or []
    audits, worst = list[Audit | None](), 0.0
    for audit, x in zip(audited.audits, off, strict=True):
        worst = max(worst, x)
        audits.append(audit and replace(audit, files=float(f"{worst:.6g}")))
        worst = worst if audit is None else 0.0
    return _judged(simulation, steps, audits, audited.shared)


def _judged(
    simulation: Simulation, steps: Sequence[StepResult], audits: Sequence[Audit | None], shared: tuple[str, ...]
) -> Audited:
    times, errors = [step.time for step in steps], [step.law_error for step in steps]
    over = passed(audits, times, errors, simulation.scene.solver.tolerance)
    return Audited(audits=tuple(audits), shared=shared, passed=tuple(over))


def _record(folder: Path, index: int, dim: int, time: float, files: WrittenFiles | None) -> Record | None:
    """Read a step's file and its rows of tables; None if it is a light one."""
    path = folder / step_name(index)
    if (folder / light_name(index)).exists() and not path.exists():
        contacts, stored = {}, None
    else:
        stored = read_step(path)
        contacts = {name: vars(contact) for name, contact in stored.contacts.items()}
    if files is not None:
        files.see(time, contacts)
    if stored is None:
        return None
    fields = StoredFields(stress=stored.stress, von_mises=stored.von_mises, contacts=contacts)
    return replace(Record.of(stored), displacement=stored.displacement[:, :dim], stored=fields)
