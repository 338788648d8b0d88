"""What a run goes on from, as plain data: the state, how far its methods are, the work so far, what was learnt.

Values over the volume are by node of the gmsh model, so that any number of ranks can read them. What methods have
learnt is for the same ranks only: it makes no answer better, but it decides the last bits.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from geometry.arrays import Array
from solvers.interface.matrix_free import IterativeVolume
from solvers.parallel.counters import Counters
from solvers.parallel.gather import Gather, nodes_of
from solvers.parallel.serialise import ByNode, Own, Plain, deserialise, serialise
from solvers.stepping.attempts import Reached
from solvers.stepping.state import State
from solvers.stepping.stepper import Accepted, Stepper

ROWS = "rows"  # the field of State that is built anew, from where sliding contacts were paired


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A reported step, as seen by the next one."""

    state: Plain
    searched: Mapping[str, Array]  # where sliding contacts were paired, for the rows of the state
    reached: Reached
    counters: Counters
    coarse: Counters | None  # of the coarse mesh beside


class Checkpoints:
    """Takes them from a stepper, and puts it back; all collective."""

    def __init__(self, stepper: Stepper) -> None:
        system = stepper.system
        self.stepper, self.dim = stepper, system.mesh.dim
        self._by_node: Gather = nodes_of(system.mesh, system.nodes)

    def take(self, accepted: Accepted) -> Checkpoint:
        """Right after a step was reported."""
        attempts = self.stepper.attempts
        return Checkpoint(
            state=serialise(accepted.state, self._whole, without=(ROWS,)),
            searched=accepted.stepper.searched,
            reached=attempts.reached,
            counters=self.stepper.system.counters,
            coarse=attempts.coarse.counters if attempts.coarse else None,
        )

    def learnt(self) -> Plain:
        """What later steps use beside the state, this rank's part: it can be large, and may be missing on a resume.

        Nothing is copied: it is valid until the next step begins.
        """
        attempts = self.stepper.attempts
        volume = attempts.volume
        known = {
            "surface": self.stepper.surface.snapshot(),
            "volume": volume.snapshot() if isinstance(volume, IterativeVolume) else None,
            "method": attempts.snapshot(),
        }
        return {"layout": self._layout(), **serialise(known, lambda own: own.values)}

    def put_back(self, checkpoint: Checkpoint, learnt: Plain | None) -> tuple[State, bool]:
        """The state to go on from, and whether what was learnt could be used."""
        system, attempts = self.stepper.system, self.stepper.attempts
        rows = system.searched(checkpoint.searched).contacts if checkpoint.searched else system.contacts
        state: State = deserialise(State, checkpoint.state, self._vector, rows=rows)
        system.counters.add(checkpoint.counters)
        if attempts.coarse and checkpoint.coarse:
            attempts.coarse.counters.add(checkpoint.coarse)
        if learnt is None or learnt["layout"] != self._layout():
            return state, False
        self._teach(learnt)
        return state, True

    def _teach(self, known: Mapping[str, Any]) -> None:
        attempts, surface = self.stepper.attempts, self.stepper.surface
        surface.restore(known["surface"])
        if isinstance(attempts.volume, IterativeVolume):
            attempts.volume.restore(known["volume"])
        attempts.restore(known["method"], surface)

    def _layout(self) -> str:
        """The same if the nodes are numbered and shared out the same."""
        comm = self.stepper.system.mesh.comm
        numbers = hashlib.sha256(self._by_node.numbers.tobytes()).hexdigest()
        return f"{comm.size} {comm.bcast(numbers)}"

    def _whole(self, own: Own) -> ByNode:
        return ByNode(self._by_node(own.values.reshape(-1, self.dim, *own.values.shape[1:])))

    def _own(self, whole: ByNode) -> Array:
        values = self._by_node.scatter(whole.values)
        return values.reshape(-1, *values.shape[2:])

    def _vector(self, whole: ByNode) -> Any:
        vector = self.stepper.system.vector()
        vector.array[:] = self._own(whole)
        return vector
