"""Loads in the assembled system: vectors times values in time, and those of expressions that change in time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.errors import SceneError
from stickslip.geometry.protocols import CompiledForm, Vec
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.terms import LoadTerm
from stickslip.solvers.scene.timeline import Course, Drive


class AppliedLoads:
    """The external forces of a problem, without reactions, contact and initial strains."""

    def __init__(self, weak: WeakForms, terms: Iterable[LoadTerm], given: Sequence[tuple[Drive, Vec]] = ()) -> None:
        """Compile all forms, and assemble those that only a factor changes; collective.

        Args:
            given: vectors over all displacements [N], each with the value in time that multiplies it.

        Raises:
            SceneError: an expression has no finite value, at a requested time if it changes in time.
        """
        forms = [(term, weak.compile(term.form)) for term in terms]
        fixed = [(term, _assembled(term, form, 0.0)) for term, form in forms if term.clock is None]
        self._fixed = [(term.drive, term.power, vector) for term, vector in fixed]
        self._fixed += [(drive, 1, vector) for drive, vector in given]
        self._changing = [(term, form) for term, form in forms if term.clock is not None]
        for term, form in self._changing:
            for time in weak.problem.timeline.times:
                _assembled(term, form, time)

    def __bool__(self) -> bool:
        return bool(self._fixed or self._changing)

    def add_to(self, total: Vec, course: Course, time: float) -> None:
        """Add the forces at a time [s] to a vector over all displacements [N]; collective.

        Raises:
            SceneError: an expression has no finite value.
        """
        for drive, power, vector in self._fixed:
            total.axpy(course.value(drive, time) ** power, vector)
        for term, form in self._changing:
            total.axpy(1.0, _assembled(term, form, time))


def _assembled(term: LoadTerm, form: CompiledForm, time: float) -> Vec:
    """Forces of a term at value 1 [N]; collective."""
    if term.clock is not None:
        term.clock.value = time
    vector = dx.assemble_vector(form)
    if not np.isfinite(vector.norm()):
        raise SceneError(f"{term.drive}: the expression has no finite value somewhere at t = {time:g}")
    return vector
