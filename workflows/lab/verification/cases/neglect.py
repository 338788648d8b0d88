"""What the neglect report says of effects that are off, against the same scenes with them on.

Where a property lacks, the effect is turned on with the value at which a main number is said to change by 1 %; the
largest true change of forces and energy is held against what is said. Strain and rotation are turned on by a total
Lagrangian computation of a glued block.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import stickslip
from stickslip import MeshData, Scene, Wear
from stickslip.geometry.arrays import Array
from stickslip.solvers.results.step_result import StepResult, quantities, values
from stickslip.workflows.lab.verification.check import ONE, Check, problem, within
from stickslip.workflows.lab.verification.prepared import prepare, solved
from stickslip.workflows.run.neglect import GRAVITY, REACHED, Neglected, neglected
from stickslip.workflows.run.warnings import Fields, Seen
from stickslip.workflows.scene_file.read import from_dict, read, with_keys

ASIDE = ("geometry.order=1", "steps.count=2")
CURVED = ("geometry.mesh_size=2.5", "geometry.lower_mesh_size=3.0", "geometry.contact_mesh_size=0.125", *ASIDE[:1])
FAR = "supports.top.displacement.x=[[0, 0], [1, 0], [2, 0.3]]"  # a third of the half width
ROLLED = (
    *("geometry.mesh_size=8.0", "geometry.contact_mesh_size=0.08", "steps.count=4"),
    "obstacles.roller={ shape = 'cylinder', point = [0.0, 2.0], radius = 2.0, "
    "displacement = { x = [[0, 0], [1, 0], [2, 0.08]], y = [[0, 0], [1, -0.02]] } }",
)
GLUED: dict[str, Any] = {
    "model": "plane strain",
    "geometry": {"builder": "block", "length": 2.0, "height": 1.0, "mesh_size": 0.25},
    "bodies": {"block": {"E": 6.0, "nu": 0.3}},
    "obstacles": {"floor": {"shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}},
    "contacts": {
        "base": {
            "surface": "block.bottom", "against": "floor",
            "normal": {"law": "bilateral"}, "friction": {"law": "stick"},
        }
    },
    "supports": {"top": {"boundary": "block.top", "displacement": {"x": 0.05, "y": -0.05}}},
}  # fmt: skip
On = Callable[..., Scene]


def _weight(scene: Scene, density: float, *_: float) -> Scene:
    acceleration = [0.0] * (scene.dim - 1) + [-GRAVITY]
    heavy = {f"bodies.{name}.density": density for name in scene.bodies}
    return with_keys(scene, heavy | {"gravity.acceleration": acceleration})


def _warm(body: str) -> On:
    return lambda scene, strain, *_: with_keys(scene, {f"thermal.{body}": {"expansion": strain, "temperature": 1.0}})


def _wearing(scene: Scene, k: float, *_: float) -> Scene:
    return replace(scene, contacts={name: replace(c, wear=Wear(k=k)) for name, c in scene.contacts.items()})


def _following(scene: Scene, *_: float) -> Scene:
    """Pairs, normals and gaps follow the motion."""
    return with_keys(scene, {f"contacts.{name}.sliding": True for name in scene.contacts})


def _rubbing(contact: str) -> On:
    key = f"contacts.{contact}.friction.mu"
    return lambda scene, more, *_: with_keys(scene, {key: scene.parameters()[key] + more})


CASES: tuple[tuple[str, tuple[str, ...], Mapping[str, On]], ...] = (
    ("block", (), {"gravity": _weight, "thermal expansion": _warm("block"), "friction by rate": _rubbing("base")}),
    ("two_blocks", (), {"thermal expansion": _warm("lower"), "friction by rate": _rubbing("joint")}),
    ("ring", ASIDE, {"gravity": _weight, "thermal expansion": _warm("ring"), "friction by rate": _rubbing("outside")}),
    ("shaft", (), {"wear": _wearing, "thermal expansion": _warm("ring"), "friction by rate": _rubbing("bore")}),
    ("shrink_fit", ASIDE, {"facets": lambda scene, *_: with_keys(scene, {"geometry.order": 2})}),
    ("cylinders", CURVED, {"friction by rate": _rubbing("line")}),
    ("cylinders", (*CURVED, FAR), {"sliding search": _following}),
    ("half_space", ROLLED[:3], {"friction by rate": _rubbing("track")}),
    ("half_space", ROLLED, {"sliding search": _following}),
)


def said(scene: Scene, *, estimated: bool = False) -> tuple[StepResult, dict[str, Neglected]]:
    """The last step of a scene, and the report on it by effect.

    Args:
        scene: it is solved as it is.
        estimated: whether errors of its numbers are, which strain and rotation are said by.
    """
    simulation = stickslip.prepare(scene) if estimated else prepare(scene)
    steps = [*simulation.steps()]
    fields = Fields(simulation.problem, simulation.data, simulation.system.contacts, Seen(), None)
    for step in steps:
        fields.see(step)
    assert simulation.reported is not None
    errors = [{key: step.errors[str(key)] for key in quantities(step) if str(key) in step.errors} for step in steps]
    found = neglected(simulation, steps, simulation.reported.state, fields.seen, errors)
    return steps[-1], {row.effect: row for row in found}


def changed(before: StepResult, after: StepResult, names: Collection[str]) -> float:
    """Largest relative change of forces and stored energy, of these numbers."""
    one, two = values(before), values(after)
    main = [key for key in names if key.endswith(("normal_force", "tangential_force", "energy.stored")) and one[key]]
    return max(abs(two[key] / one[key] - 1) for key in main)


@problem("what is said of effects that are off, against the same scenes with them on", ONE, slow=ONE)
def checks(method: str) -> list[Check]:
    """Estimated over true change of each effect, within .3 and 3."""
    found = list[Check]()
    for name, settings, effects in CASES:
        scene = read(name, settings)
        last, report = said(scene)
        for effect, on in effects.items():
            row, known = report[effect], values(last)
            sizes = [size / abs(known[key]) for key, size in row.changes.items() if not key.endswith("max_pressure")]
            reaches = [value for key, value in row.reaches.items() if "bodies.upper" not in key]
            estimated = REACHED if reaches else max(sizes)
            true = changed(last, solved(on(scene, *reaches, 0.0))[1][-1], [*row.changes] or [*known])
            found.append(within(f"{name}: {effect}, estimated over true", estimated / true, 0.3, 3.0))
    return [*found, *_strained()]


def _strained() -> Iterator[Check]:
    """Strain and rotation of a block that is pressed and sheared: under pressure shear is softer.

    Its forces on the top are those of the contact, whose nodes do not move.
    """
    scene = from_dict(GLUED)
    last, report = said(scene, estimated=True)
    true = total_lagrangian(prepare(scene).data, last.displacement) - last.supports["top"].force
    for key, change in zip(("tangential_force", "normal_force"), np.abs(true), strict=True):
        estimated = report["strain and rotation"].changes[f"base.{key}"]
        yield within(f"glued block: strain and rotation, {key}, estimated over true", estimated / change, 0.3, 3.0)


def total_lagrangian(mesh: MeshData, u: Array, E: float = 6.0, nu: float = 0.3) -> Array:
    """Force on the top of a block of triangles at finite strain, by Newton's method on all nodes at once.

    The first Piola-Kirchhoff stress F S balances on the undeformed mesh, F = 1 + grad u, S = C : (F^T F - 1) / 2 after
    St. Venant and Kirchhoff. Nodes of both ends are moved as by u; the others begin there.

    Args:
        mesh: of triangles of order 1, its lower end at y = 0, in plane strain.
        u: displacements (n, 2) [m].
        E: Young's modulus [Pa].
        nu: Poisson's ratio [-].

    Returns:
        Sum (2,) of the inner forces of the nodes of the upper end [N/m].

    Raises:
        AssertionError: it has not converged in 30 iterations.

    Source: Bathe, Finite Element Procedures (1996), section 6.3.
    """
    lame, shear = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    X, cells, u = mesh.points, mesh.cells, u.copy()
    slope = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]])
    jacobian = np.einsum("kn,cni->cki", slope, X[cells])
    gradients, area = np.linalg.inv(jacobian) @ slope, np.abs(np.linalg.det(jacobian)) / 2
    ends = (X[:, 1] < 1e-9) | (X[:, 1] > X[:, 1].max() - 1e-9)
    free = np.flatnonzero(np.repeat(~ends, 2))
    dofs = (2 * cells[:, :, None] + np.arange(2)).reshape(len(cells), -1)
    eye = np.eye(2)
    for _ in range(30):
        H = np.einsum("cni,cjn->cij", u[cells], gradients)
        F = eye + H
        strain = (np.swapaxes(F, 1, 2) @ F - eye) / 2
        S = lame * np.trace(strain, axis1=1, axis2=2)[:, None, None] * eye + 2 * shear * strain
        force, K = np.zeros(X.size), np.zeros((X.size, X.size))
        at_nodes = np.einsum("c,cij,cjn->cni", area, F @ S, gradients)
        np.add.at(force, dofs, at_nodes.reshape(len(cells), -1))
        dF = np.einsum("ab,cjn->cnbaj", eye, gradients)  # (c, n, b) to dF_aj
        dE = np.einsum("cka,cnbkj->cnbaj", F, dF)
        dE = (dE + np.swapaxes(dE, -1, -2)) / 2
        dS = lame * np.einsum("cnbaa->cnb", dE)[..., None, None] * eye + 2 * shear * dE
        local = np.einsum("cnbij,cmdij->cnbmd", dS, dE) + np.einsum("cnbij,cjk,cmdik->cnbmd", dF, S, dF)
        local = (area[:, None, None, None, None] * local).reshape(len(cells), 6, 6)
        np.add.at(K, (dofs[:, :, None], dofs[:, None, :]), local)
        if np.abs(force[free]).max() < 1e-8 * np.abs(force).max():
            top = X[:, 1] > X[:, 1].max() - 1e-9
            return np.asarray(force.reshape(-1, 2)[top].sum(axis=0))
        u.ravel()[free] -= np.linalg.solve(K[np.ix_(free, free)], force[free])
    raise AssertionError("Newton's method has not converged")
