"""Checkpoints as plain data: the state, the method in use, the work so far, and what methods have learnt.

Values over the volume are by node of the gmsh model: any number of ranks can read them. What methods have learnt needs
the same ranks; without it the answer is as accurate, but differs in the last bits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from stickslip.geometry.arrays import Array
from stickslip.geometry.protocols import Vec
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.gather import Gather, nodes_of
from stickslip.solvers.parallel.serialise import ByNode, Own, Plain, deserialise, serialise
from stickslip.solvers.stepping.method_chain import Reached
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Accepted, Stepper
from stickslip.solvers.system.system import System

ROWS = "rows"  # field of State that is not stored: it is built again from the pairs of sliding contacts
APART = ("surplus", "refined", "neighbours")  # fields with other states, or vectors of order 2, stored apart
FOR_RESULTS = ("reactions", "ground")  # not needed by the next step


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """Everything of a solved step that the next one needs, but for what methods have learnt."""

    state: Plain  # of `State`, without its rows
    refined: Plain  # likewise of the state with bubbles, if it is followed
    surplus: Plain  # its bubbles, by node of order 2
    neighbours: tuple[Plain, ...]  # likewise of states with other numbers in the scene, if they are followed
    reached: Reached  # methods that were tried and left, and the one in use
    counters: Counters  # work so far
    coarse: Counters | None  # work on the coarse mesh that helps the method, if there is one


class Checkpoints:
    """Takes checkpoints from a stepper, and puts them back into another one of the same scene; all collective."""

    def __init__(self, stepper: Stepper) -> None:
        """Prepare to gather values over the volume on rank 0."""
        system = stepper.system
        self.stepper, self.dim = stepper, system.mesh.dim
        self._by_node: Gather = nodes_of(system.mesh, system.nodes)
        self._by_bubble = nodes_of(system.mesh, stepper.companion.nodes) if stepper.companion else None

    def take(self, accepted: Accepted) -> Checkpoint:
        """The checkpoint of a step; call it before the next step begins."""
        chain = self.stepper.chain
        plain = partial(serialise, whole=self._whole, without=(ROWS, *FOR_RESULTS, *APART))
        refined = accepted.state.refined
        return Checkpoint(
            state=plain(accepted.state),
            refined=refined and plain(refined),
            surplus=refined and refined.surplus and self._bubbles_of(refined.surplus),
            neighbours=tuple(map(plain, accepted.state.neighbours)),
            reached=chain.reached,
            counters=replace(self.stepper.system.counters),
            coarse=replace(chain.coarse.counters) if chain.coarse else None,
        )

    def learnt(self) -> Plain:
        """This rank's part of what methods have learnt, with the layout of nodes and ranks that it belongs to.

        It can be large, and a resumed run can do without it. Nothing is copied: it is valid until the next step begins.
        """
        chain = self.stepper.chain
        known = {
            "surface": self.stepper.surface.snapshot(),
            "volume": chain.volume.snapshot(),
            "method": chain.snapshot(),
        }
        return {"layout": self._layout(), **serialise(known, lambda own: own.values)}

    def put_back(self, checkpoint: Checkpoint, learnt: Plain | None) -> tuple[State, bool]:
        """Continue from a checkpoint: counters are added to the stepper's own.

        Args:
            checkpoint: of a run of the same scene; its values by node are on rank 0.
            learnt: what `learnt` returned on this rank; None: lost.

        Returns:
            The state that the next step starts from, and whether `learnt` could be used: not on other ranks.
        """
        system, chain = self.stepper.system, self.stepper.chain

        def rows_of(system: System, state: Plain) -> dict[str, Any]:
            searched = state["searched"]
            return {ROWS: system.searched(searched).contacts if searched else system.contacts}

        given = rows_of(system, checkpoint.state) | dict.fromkeys((*FOR_RESULTS, *APART)) | {"neighbours": ()}
        state: State = deserialise(State, checkpoint.state, self._vector, **given)
        if self.stepper.neighbours:
            solvers = zip(checkpoint.neighbours, self.stepper.neighbours.solvers, strict=True)
            others = (deserialise(State, near, self._vector, **given | rows_of(s.system, near)) for near, s in solvers)
            state = replace(state, neighbours=tuple(others))
        if checkpoint.refined is not None and self.stepper.companion:
            surplus = self._bubbles(checkpoint.surplus, self.stepper.companion.vector())
            refined = deserialise(State, checkpoint.refined, self._vector, **given | {"surplus": surplus})
            state = replace(state, refined=refined)
        system.counters.add(checkpoint.counters)
        if chain.coarse and checkpoint.coarse:
            chain.coarse.counters.add(checkpoint.coarse)
        if learnt is None or learnt["layout"] != self._layout():
            return state, False
        self._teach(learnt)
        return state, True

    def _teach(self, known: Mapping[str, Any]) -> None:
        """Give the bodies and the method what they had learnt."""
        chain, surface = self.stepper.chain, self.stepper.surface
        surface.restore(known["surface"])
        chain.volume.restore(known["volume"])
        chain.restore(known["method"], surface)

    def _layout(self) -> str:
        """Number of ranks, and a hash of the numbering of nodes: learnt data fit only the same layout."""
        comm = self.stepper.system.mesh.comm
        numbers = hashlib.sha256(self._by_node.numbers.tobytes()).hexdigest()
        return f"{comm.size} {comm.bcast(numbers)}"

    def _whole(self, own: Own) -> ByNode:
        """Gather this rank's part of a vector on rank 0; collective."""
        return ByNode(self._by_node(own.values.reshape(-1, self.dim, *own.values.shape[1:])))

    def _bubbles_of(self, surplus: Vec) -> ByNode:
        """Gather bubbles on rank 0; collective."""
        assert self._by_bubble is not None
        return ByNode(self._by_bubble(surplus.array_r.reshape(-1, self.dim)))

    def _bubbles(self, whole: ByNode, vector: Vec) -> Vec:
        """Scatter them into a vector; collective."""
        assert self._by_bubble is not None
        vector.array[:] = self._by_bubble.scatter(whole.values).ravel()
        return vector

    def _own(self, whole: ByNode) -> Array:
        """Scatter a vector of rank 0: this rank's part; collective."""
        values = self._by_node.scatter(whole.values)
        return values.reshape(-1, *values.shape[2:])

    def _vector(self, whole: ByNode) -> Vec:
        """The same as a PETSc vector; collective."""
        vector = self.stepper.system.vector()
        vector.array[:] = self._own(whole)
        return vector
