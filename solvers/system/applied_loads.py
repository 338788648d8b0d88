"""Loads, initial strains and elongations of springs in the assembled system: forces, values in time, and energy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.protocols import CompiledForm, Vec
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.springs import Rest
from stickslip.solvers.fem.terms import InitialStrain, LoadTerm
from stickslip.solvers.scene.timeline import Course, Drive, Place, Timeline


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
        self.fixed = [(term.drive, term.power, vector) for term, vector in fixed]
        self.fixed += [(drive, 1, vector) for drive, vector in given]
        self.changing = [(term, form) for term, form in forms if term.clock is not None]
        for term, form in self.changing:
            for time in weak.problem.timeline.times:
                _assembled(term, form, time)

    def __bool__(self) -> bool:
        return bool(self.fixed or self.changing)

    def add_to(self, total: Vec, course: Course, time: float) -> None:
        """Add the forces at a time [s] to a vector over all displacements [N]; collective.

        Raises:
            SceneError: an expression has no finite value.
        """
        for drive, power, vector in self.fixed:
            total.axpy(course.value(drive, time) ** power, vector)
        for term, form in self.changing:
            total.axpy(1.0, _assembled(term, form, time))


def _assembled(term: LoadTerm, form: CompiledForm, time: float) -> Vec:
    """Forces of a term at value 1 [N]; collective."""
    if term.clock is not None:
        term.clock.value = time
    vector = dx.assemble_vector(form)
    if not np.isfinite(vector.norm()):
        raise SceneError(f"{term.drive}: the expression has no finite value somewhere at t = {time:g}")
    return vector


@dataclass(frozen=True, kw_only=True)
class Tightened:
    """A bolt whose tension is given, or a spring that acts in one way: its shortening, or its slack, is found."""

    index: int  # among the initial strains
    tension: Place | None  # [N]; None: a spring's slack + gap and force are not negative, and one of them is zero
    shortening: Place  # [m]
    held_from: float  # [s]
    gap: float = 0.0  # [m]


@dataclass(frozen=True, kw_only=True)
class InitialStrains:
    """The k initial strains of a problem, those of bodies first; each is proportional to a value in time a (k,)."""

    strains: tuple[InitialStrain, ...]
    rests: tuple[Rest, ...]
    forces: tuple[Vec, ...]  # ∫ C strain : eps(v) dx at value 1, PETSc over all displacements [N]
    coupling: Array  # (k, k) ∫ strain_i : C strain_j dx at value 1 [J]
    by_cell: Mapping[int, Array]  # strains (own cells, 3, 3) [-] of those that shrink, by their number
    means: Mapping[int, Array]  # dilatation (cells,) [-] of those that `MeanDilatation` averages, by their number

    @cached_property
    def every(self) -> tuple[InitialStrain | Rest, ...]:
        """All k."""
        return *self.strains, *self.rests

    @cached_property
    def tightened(self) -> tuple[Tightened, ...]:
        """Bolts whose tension is given, and springs that act in one way."""
        return tuple(
            Tightened(
                index=index,
                tension=each.tension,
                shortening=each.drive,
                held_from=each.held_from,
                gap=each.gap if isinstance(each, Rest) else 0.0,
            )
            for index, each in enumerate(self.every)
            if (each.tension is not None or _slackens(each)) and isinstance(each.drive, Place)
        )

    @cached_property
    def slacks(self) -> Ints:
        """Numbers of the springs that act in one way."""
        return np.array([k for k, each in enumerate(self.every) if _slackens(each)], np.int64)

    @cached_property
    def _least(self) -> Array:
        """Slack of those when they act [m]."""
        return np.array([-each.gap for each in self.every if isinstance(each, Rest) and each.slack])

    def followed(self, values: Array, work: Array) -> Array:
        """Values (k,) with which springs that are slack are free of force, wherever their ends are.

        Args:
            values: (k,), with some slack.
            work: see `stress_work`, at these values.
        """
        loose = self.slacks[values[self.slacks] > self._least]
        found = values.copy()
        found[loose] += work[loose] / self.coupling[loose, loose]
        return found

    def at(self, number: int, points: Array, cells: Ints, timeline: Timeline) -> Array:
        """Strain (m, 3, 3) [-] of a number at value 1, at the midpoints (m, d) [m] of own cells (m,).

        Raises:
            SceneError: its expression has no finite value at a point.
        """
        strain = self.strains[number]
        if number in self.by_cell:
            found: Array = self.by_cell[number][cells]
            return found
        size = np.ones(len(points))
        if strain.field is not None:
            size = timeline.values(strain.field, points, timeline.end)
        return np.asarray(size[:, None, None] * strain.strain)

    def dilatation(self, number: int, strain: Array, cells: Ints) -> Array:
        """Its dilatation (m,) [-] in own cells (m,), where it has the `strain` (m, 3, 3) of `at`."""
        if number in self.means:
            return np.asarray(self.means[number][cells])
        return np.asarray(np.trace(strain, axis1=1, axis2=2))

    def values(self, course: Course, time: float) -> Array:
        """a (k,) at a time [s]."""
        return np.array([course.value(each.drive, time) for each in self.every], float)

    def added(self, load: Vec, values: Array) -> Vec:
        """Load plus the forces of the initial strains, over all displacements [N]; `load` itself if there are none."""
        if not self.forces:
            return load
        total = load.copy()
        for value, force in zip(values, self.forces, strict=True):
            total.axpy(value, force)
        return total

    def stress_work(self, values: Array, u: Vec) -> Array:
        """∫ sigma : strain dx (k,) [J] of the stress at displacement u and values a."""
        return np.asarray([force.dot(u) for force in self.forces] - self.coupling @ values)

    def stored(self, values: Array, work: Array) -> float:
        """Energy [J] to add to u . K u / 2, so that the sum is that of the elastic strain eps(u) - initial strain.

        Args:
            work: see `stress_work`.
        """
        return float(-values @ (work + self.coupling @ values / 2))

    def external(self, before: Array, after: Array, work_before: Array, work_after: Array) -> tuple[float, float]:
        """Work [J] that the change of the values does on the stressed bodies, exact for linear elasticity.

        Returns:
            That of what is prescribed, and that of slacks: on the exact way these do none, for no force acts on them.
        """
        work = -(after - before) * (work_before + work_after) / 2
        of_slacks = float(work[self.slacks].sum())
        return float(work.sum()) - of_slacks, of_slacks


def _slackens(each: InitialStrain | Rest) -> bool:
    return isinstance(each, Rest) and each.slack
