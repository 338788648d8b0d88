"""Parts of the mesh that can move by themselves, which no scene shows: a body's cells need not hang together."""

from __future__ import annotations

from itertools import chain

import numpy as np

from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.joints import is_rigid
from stickslip.solvers.effects import active
from stickslip.solvers.method_registry import method_of
from stickslip.solvers.system.contact_interface import UNTOUCHED, loose_part
from stickslip.solvers.system.system import System


def refuse_loose_parts(system: System) -> None:
    """Check that contact holds what supports do not, and that the method can solve that; collective.

    The scene's own bodies are checked before the mesh, see `planned`.

    Raises:
        SceneError: nothing resists a motion, or the method needs bodies that their supports hold.
    """
    _refuse_dangling(system)
    interface, problem = system.interface, system.problem
    modes = interface.rigid_modes
    if modes.shape[1] <= problem.rigid_modes.shape[1]:
        return
    resisted = [np.zeros((0, modes.shape[1]))]
    for rows in system.contacts:
        tangential = problem.pairs[rows.name].contact.tangential
        moved = interface.trace(rows) @ modes
        resisted += [N @ moved for N in (rows.N_n, rows.N_t)[: 1 + bool(tangential and tangential.resists())]]
    interface.refuse_loose(np.concatenate(resisted), "that contact does not resist ")
    method = method_of(problem.solver)
    if not method.WORKS_WITH.floating:
        raise SceneError(
            f"solver.method = {problem.solver.method}: needs bodies that their supports hold in all parts of the mesh; "
            "contact alone holds one; use condensed-newton"
        )
    for effect in active(problem):
        if effect.other_stiffness(problem):
            raise SceneError(f"{effect.name}: needs bodies that their supports hold in all parts; add a support")


def _refuse_dangling(system: System) -> None:
    """Refuse a part that nothing touches and that can turn even if the rest stands still.

    It needs no list of all motions, which would be long for a mesh that falls into thousands of parts.
    """
    mesh, joints = system.mesh, system.mesh.joints
    of = system.constraints
    own, periodic = of.held[of.is_own(of.held)] - of.nodes.offset, of.periodic
    held = np.unique(np.concatenate([of.nodes.part[own], of.sprung.part])).tolist()
    touched = {*chain.from_iterable(mesh.comm.allgather(held)), *of.links.parts}
    touched.update(np.unique([*periodic.part, *periodic.root_part]).tolist())
    touched.update(*(point.part.tolist() for point in of.remote.rigid if point.rows))
    touched.update(*(np.unique(rows.part).tolist() for rows in system.contacts))
    for part in range(mesh.part_count) if mesh.part_count > 1 else ():
        points = joints.points[(joints.parts == part).any(axis=1)]
        held = len(points) > 0 if mesh.axisymmetric else is_rigid(points)
        if part not in touched and not held:
            raise loose_part(UNTOUCHED, points[0] if len(points) else None)
