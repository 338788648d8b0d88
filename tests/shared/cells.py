"""Cells of the table of applicability: one small scene for each method, laws, operator, model, and what more it has."""

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields, replace
from functools import cache, lru_cache
from typing import Any, get_type_hints

import numpy as np
from mpi4py import MPI

from stickslip import FrictionLaw, Key, NormalLaw, Scene, SceneError, Simulation, StepResult
from stickslip.solvers.contact.pairing import OPERATORS
from stickslip.solvers.methods.method import RIGID
from stickslip.solvers.simulation.plan import make_plan
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.scene_file.read import from_dict

NORMAL: dict[str, dict[str, Any]] = {"compliance": {"c_n": 20.0, "m_n": 2.0}}  # parameters of laws that need some
TYPICAL: dict[str, Any] = {
    "-": 0.3,
    "Pa": 0.008,
    "Pa/m^m_T": 0.2,
    "m": 0.02,
    "m/s": 0.02,
    "Pa, -": [[0.0, 0.4], [0.1, 0.3]],
    "m, -": [[0.0, 0.3], [0.02, 0.2]],
    "m/s, -": [[0.0, 0.2], [0.02, 0.4]],
}  # a value for a key of friction that has no default, by its unit
SPECIAL: dict[str, dict[str, Any]] = {
    "static_kinetic": {"mu_k": 0.2},
    "rate_and_state": {"a": 0.02, "b": 0.01},
    "orthotropic_coulomb": {"mu_2": 0.15, "axis": [0.6, 0.8, 0.0]},
}  # where laws say more


def parameters(law: type[FrictionLaw]) -> dict[str, Any]:
    """What the law needs; a new law has its cells without a line here."""
    hints = get_type_hints(law, include_extras=True)
    needed = [f.name for f in fields(law) if f.default is MISSING]
    found = {name: TYPICAL[next(m.unit for m in hints[name].__metadata__ if isinstance(m, Key))] for name in needed}
    return found | SPECIAL.get(law.law, {})


FRICTION: dict[str, dict[str, Any]] = {law.law: parameters(law) for law in FrictionLaw.kinds}
MODELS = ("plane strain", "axisymmetric", "3d")
FORMS = ("condensed", "matrix-free")  # of the bodies
MORE = ("order 2", "tensor", "k_T", "sliding", "floating", "driven", *FORMS)
FACETS = {2: "node-to-segment", 3: "node-to-face"}
REFERENCE = "condensed-newton"
# the lower one gives way sideways more: the upper one's nodes stay above it
SOFTER = {"upper": {"E": 2.0, "nu": 0.1}, "lower": {"E": 1.0, "nu": 0.3}}


@cache
def made(family: Any, name: str | None) -> Any:
    """The law of that name with the parameters of its cells; None has none."""
    values = NORMAL if family is NormalLaw else FRICTION
    return name and next(law for law in family.kinds if law.law == name)(**values.get(name, {}))


@dataclass(frozen=True)
class Cell:
    method: str
    normal: str = "unilateral"
    friction: str | None = "coulomb"
    operator: str = RIGID
    model: str = "plane strain"
    more: str = ""

    def __str__(self) -> str:
        words = (self.method, self.normal, self.friction or "smooth", self.operator, self.model, self.more)
        return ", ".join(filter(None, words))

    @property
    def dim(self) -> int:
        return 3 if self.model == "3d" else 2

    @property
    def exists(self) -> bool:
        """Whether there is such a scene, by any method."""
        normal, friction = made(NormalLaw, self.normal), made(FrictionLaw, self.friction)
        if self.operator in FACETS.values() and self.operator != FACETS[self.dim]:
            return False
        if friction is not None and (normal.ties or friction.refuses(normal)):
            return False
        if friction is not None and friction.orthotropic and self.dim == 2:
            return False
        turns = self.model != "axisymmetric"  # with one rigid motion, gram-uzawa happens to hold what it need not
        # a disc on a disc as large: whether its last node has slid off is a matter of rounding
        ends = self.model == "axisymmetric" and self.operator in FACETS.values()
        needs = {"k_T": friction, "floating": (friction or normal.ties) and turns, "sliding": not (normal.ties or ends)}
        return bool(needs.get(self.more, True)) and (self.more != "driven" or self.operator == RIGID)

    def scene(self, tolerance: float) -> Scene:
        """Pressed, then dragged and relieved: a part slips, a part sticks, on an obstacle a part lifts off."""
        dim, rigid, round_ = self.dim, self.operator == RIGID, self.model == "axisymmetric"
        axes, body = "xyz"[:dim], "block" if rigid else "upper"
        cell = 0.25 if dim == 2 or self.more == "sliding" else 0.5  # nodes at the edge may slide off the other side
        shape: dict[str, Any] = {"builder": "block", "length": 1.0, "height": 0.5, "mesh_size": cell}
        if dim == 3:
            shape["width"] = 0.5
        if not rigid:  # meshes that do not match
            shape |= {"builder": "two_blocks", "lower_height": 0.4, "lower_mesh_size": 0.7 * cell}
        shape |= {"order 2": {"order": 2}, "tensor": {"cells": "tensor"}}.get(self.more, {})
        way = {(True, False): 0.012, (False, False): 0.02, (True, True): 0.15, (False, True): 0.05}[
            rigid, self.more == "sliding"
        ]
        moved: dict[str, Any] = {"x": [[0, 0], [1, 0], [2, way]], "y": [[0, 0], [1, 0], [2, 0.4 * way]]}
        if round_:
            moved["x"] = 0.0
        moved[axes[-1]] = [[0, 0], [1, -0.05], [2, -0.06 if round_ else -0.02 if rigid else -0.035]]
        tables: dict[str, Any] = {"supports": {"top": {"boundary": f"{body}.top", "displacement": moved}}}
        if not rigid:
            tables["supports"]["base"] = {"boundary": "lower.bottom", "displacement": dict.fromkeys(axes, 0.0)}
        if self.more == "floating":
            del tables["supports"]["top"]
            push = [0.0 if round_ else 0.004] + [0.0] * (dim - 2) + [-0.03]
            tables["loads"] = {"top": {"boundary": f"{body}.top", "traction": push}}
        if rigid:
            tables["obstacles"] = {"other": self._obstacle()}
        return from_dict(
            {
                "model": self.model,
                "geometry": shape,
                "bodies": {"block": {"E": 1.0, "nu": 0.3}} if rigid else SOFTER,
                "contacts": {"base": self._contact(f"{body}.bottom", "other" if rigid else "lower.top")},
                "steps": {"end": 2.0, "count": 2, "seconds": True},
                "solver": {
                    "method": self.method,
                    "tolerance": tolerance,
                    "surface": self.more if self.more in FORMS else "auto",
                },
                **tables,
            }
        )

    def _obstacle(self) -> dict[str, Any]:
        up = [0.0] * (self.dim - 1)
        if self.more == "sliding":  # a round one: on a plane, motion changes neither gaps nor normals
            if self.model == "plane strain":
                return {"shape": "cylinder", "point": [0.5, -1.0], "radius": 1.0}
            middle = [0.5, 0.25] if self.dim == 3 else [0.0]
            return {"shape": "sphere", "center": [*middle, -1.0], "radius": 1.0}
        # a part lifts off when relieved; where a coarse compliant face ends, methods bound its friction differently
        lean = [0.0 if self.model == "axisymmetric" or self.normal == "compliance" else 0.03, *up[1:]]
        plane: dict[str, Any] = {"shape": "plane", "point": [*up, 0.0], "normal": [*lean, 1.0]}
        if self.more == "driven":
            plane["force"] = {"xyz"[self.dim - 1]: 0.02}
        return plane

    def _contact(self, surface: str, against: str) -> dict[str, Any]:
        made: dict[str, Any] = {"surface": surface, "against": against}
        made["normal"] = {"law": self.normal} | NORMAL.get(self.normal, {})
        if self.friction:
            soft = {"k_T": 1.0} if self.more == "k_T" else {}
            made["friction"] = {"law": self.friction} | FRICTION[self.friction] | soft
        if self.operator != RIGID:
            made["operator"] = self.operator
        return made | ({"sliding": True} if self.more == "sliding" else {})


def whole(method: str, model: str) -> Iterator[Cell]:
    """Every law with every operator, then all that is more with every operator."""
    frictions = [None, *(law.law for law in FrictionLaw.kinds)]
    for operator in (RIGID, *OPERATORS):
        laws = [Cell(method, n.law, friction, operator, model) for n in NormalLaw.kinds for friction in frictions]
        more = [Cell(method, operator=operator, model=model, more=each) for each in MORE]
        yield from (cell for cell in (*laws, *more) if cell.exists)


def solved(scene: Scene, comm: Any = MPI.COMM_SELF) -> tuple[Simulation, list[StepResult]]:
    """All steps; collective."""
    simulation = prepare(scene, comm)
    return simulation, list(simulation.steps())


@lru_cache
def reference(cell: Cell, tolerance: float) -> list[StepResult]:
    """The same scene by the method that does all."""
    form = "" if cell.more in FORMS else cell.more
    return solved(replace(cell, method=REFERENCE, more=form).scene(tolerance))[1]


def largest(found: list[StepResult], expected: list[StepResult]) -> float:
    """Difference of displacements and of forces, each relative to the largest of all steps."""
    most = 0.0
    for of in (lambda step: step.displacement, lambda step: step.contacts["base"].force):
        size = max(np.abs(of(step)).max() for step in expected)
        most = max(most, *(np.abs(of(a) - of(b)).max() / size for a, b in zip(found, expected, strict=True)))
    return float(most)


def refused(cell: Cell) -> str | None:
    """The sentence that refuses it, if there is one."""
    try:
        make_plan(cell.scene(1e-9))
    except SceneError as error:
        return str(error)
    return None
