"""The same bodies with other parameters of contact laws, and other gap offsets, from some state on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.stepping.state import State
from stickslip.solvers.stepping.stepper import Stepper


def with_laws(stepper: Stepper, contacts: Mapping[str, Contact], state: State) -> tuple[Stepper, State]:
    """A stepper of the same bodies, and a state for it.

    Args:
        contacts: by name, those that change; the kinds of their laws stay.
        state: to go on from.
    """
    system, problem = stepper.system, stepper.system.problem
    rows = []
    for c in system.contacts:
        contact = contacts.get(c.name, problem.pairs[c.name].contact)
        nearer = contact.gap_offset - problem.pairs[c.name].contact.gap_offset
        rows.append(replace(c, friction=contact.tangential, gap=c.gap + nearer, node_gap=c.node_gap + nearer))
    pairs = {name: replace(pair, contact=contacts.get(name, pair.contact)) for name, pair in problem.pairs.items()}
    changed = replace(system, problem=replace(problem, pairs=pairs), contacts=tuple(rows))
    other = Stepper(changed, stepper.chain, stepper.searched)
    if other.stage.surface == stepper.stage.surface:
        other.surface.adopt(stepper.surface)
    other.companion = stepper.companion
    refined = state.refined and replace(state.refined, rows=changed.contacts)
    return other, replace(state, rows=changed.contacts, refined=refined)
