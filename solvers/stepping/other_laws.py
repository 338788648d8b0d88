"""The same bodies with other parameters of contact laws, and other gap offsets, from some state on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Stepper


def with_laws(stepper: Stepper, contacts: Mapping[str, Contact], state: State) -> tuple[Stepper, State]:
    """A stepper of the same bodies, and a state for it.

    Args:
        contacts: by name, those that change; the kinds of their laws stay.
        state: to go on from. Its rows stay those of its own pairs: sliding contacts were searched since.
    """
    system, problem = stepper.system, stepper.system.problem

    def changed(rows: tuple[ContactRows, ...]) -> tuple[ContactRows, ...]:
        found = []
        for c in rows:
            contact = contacts.get(c.name, problem.pairs[c.name].contact)
            nearer = contact.gap_offset - problem.pairs[c.name].contact.gap_offset
            found.append(replace(c, friction=contact.tangential, gap=c.gap + nearer, node_gap=c.node_gap + nearer))
        return tuple(found)

    pairs = {name: replace(pair, contact=contacts.get(name, pair.contact)) for name, pair in problem.pairs.items()}
    own = changed(system.contacts)
    other = Stepper(
        replace(system, problem=replace(problem, pairs=pairs), contacts=own), stepper.chain, stepper.searched
    )
    if other.volume is stepper.volume:
        other.surface.adopt(stepper.surface)
    other.companion = stepper.companion
    rows = own if state.rows is system.contacts else changed(state.rows)
    return other, replace(state, rows=rows, refined=state.refined and replace(state.refined, rows=rows))
