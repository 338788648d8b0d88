"""Remote points: a force, moment or motion of a point that is coupled to a side of a body."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple

import numpy as np

from stickslip.geometry.amplitude import Amplitude, check
from stickslip.geometry.arrays import Array
from stickslip.geometry.errors import SceneError, require, require_components
from stickslip.geometry.keys import TABLE, Key, Vector
from stickslip.geometry.obstacles.obstacle import AXES, ByAxis
from stickslip.solvers.effects.effect import Effect, Equilibrium, named
from stickslip.solvers.fem.rigid_fields import parts_of_motion
from stickslip.solvers.scene.loads import Coupling
from stickslip.solvers.scene.record import Number
from stickslip.solvers.scene.scene import EffectTable, Scene
from stickslip.solvers.scene.timeline import Place

PAIRS = {"force": "displacement", "moment": "rotation"}  # what is given of a component, one of the two


class RemoteState(NamedTuple):
    """Motion of a remote point, and what it exerts on its side, loads and reactions together."""

    displacement: Annotated[Array, Number("m", "by component", "vector", "displacement")]
    rotation: Annotated[Array, Number("rad", "in the plane about z", "turn", "rotation")]
    force: Annotated[Array, Number("N", "by component", "vector", "force")]
    moment: Annotated[Array, Number("N m", "about the point", "turn", "moment")]


@dataclass(frozen=True, kw_only=True)
class RemotePoint(EffectTable):
    """A point that is coupled to a side; components of its motion that are not prescribed are free."""

    reports = RemoteState

    boundary: Annotated[str, Key("-", "side, as body.side")]
    point: Annotated[Vector, Key("m", "where force and moment act; it may lie anywhere")]
    coupling: Annotated[
        Literal["rigid", "distributing"],
        Key("-", "the side moves as a rigid body, or deforms: the point then follows its mean motion"),
    ]
    force: Annotated[ByAxis, Key("N", "by component, in time; plane: per metre"), TABLE] = field(default_factory=dict)
    moment: Annotated[ByAxis, Key("N m", "by axis, in time; plane: z, per metre"), TABLE] = field(default_factory=dict)
    displacement: Annotated[ByAxis, Key("m", "rigid: prescribed, by component, in time"), TABLE] = field(
        default_factory=dict
    )
    rotation: Annotated[ByAxis, Key("rad", "rigid: prescribed and small, by axis, in time"), TABLE] = field(
        default_factory=dict
    )

    def __post_init__(self) -> None:
        for key, motion in PAIRS.items():
            for axis, amplitude in [*getattr(self, key).items(), *getattr(self, motion).items()]:
                check(amplitude, f"{key if axis in getattr(self, key) else motion}.{axis}")
            for axis in getattr(self, key):
                if axis in getattr(self, motion):
                    raise SceneError(f"{key}.{axis}: {motion}.{axis} is prescribed too; keep one of the two")
            if self.coupling == "distributing" and getattr(self, motion):
                raise SceneError(f"{motion}: a distributing coupling takes force and moment; set coupling = rigid")

    def amplitudes(self) -> Mapping[tuple[str, str], Amplitude]:
        keys = [*PAIRS, *PAIRS.values()]
        return {(key, axis): value for key in keys for axis, value in getattr(self, key).items()}

    def check(self, scene: Scene, key: str) -> None:
        scene.require_side(self.boundary, f"{key}.boundary")
        require_components(self.point, f"{key}.point", scene.dim)
        only = "displacement and force along y" if scene.axisymmetric else "x and y, and turns about z"
        for name, axis in self.amplitudes():
            known = (PAIRS.get(name, name), axis) in _components(scene)
            require(known, f"{key}.{name}.{axis}", "given", f"this model has {only}")

    def couplings(self, scene: Scene, key: str) -> tuple[Coupling, ...]:
        table, _, name = key.partition(".")
        given = {pair: Place(table, name, *pair) for pair in self.amplitudes()}
        index = {pair: i for i, pair in enumerate(_components(scene))}
        return (
            Coupling(
                boundary=self.boundary,
                point=self.point,
                rigid=self.coupling == "rigid",
                prescribed={index[pair]: place for pair, place in given.items() if pair in index},
                loads={index[PAIRS[key], axis]: place for (key, axis), place in given.items() if key in PAIRS},
                key=key,
            ),
        )


def _components(scene: Scene) -> Sequence[tuple[str, str]]:
    """Kind and axis of each of the k motions of a rigid body, in the order of `rigid_fields`."""
    if scene.axisymmetric:
        return [("displacement", "y")]
    axes = AXES[: scene.dim]
    return [("displacement", a) for a in axes] + [("rotation", a) for a in (("z",) if scene.dim == 2 else axes)]


class _RemotePoints(Effect):
    name = "remote_points"
    table = Mapping[str, RemotePoint]

    def adds(self, scene: Scene) -> str:
        rigid = sum(coupling.rigid for coupling in scene.couplings())
        spread = len(scene.couplings()) - rigid
        words = [f"{rigid} rigid: the nodes of the side move as one, fewer unknowns"] * bool(rigid)
        return "; ".join([*words, *[f"{spread} distributing: a load"] * bool(spread)])

    def read(self, reached: Equilibrium) -> Mapping[str, RemoteState]:
        found, dim = dict[str, RemoteState](), reached.problem.dim
        for name, coupling in named(self.name, {each.key: each for each in reached.problem.couplings}).items():
            motion = reached.couplings[coupling.key]
            load = np.zeros(len(motion))
            for component, place in coupling.loads.items():
                load[component] = reached.value(place)
            (moved, turned), (force, moment) = (parts_of_motion(part, dim) for part in (motion, load))
            held = reached.reactions.get(coupling.key, (0.0, 0.0))
            found[name] = RemoteState(moved, turned, force + held[0], moment + held[1])
        return found


EFFECT = _RemotePoints()
