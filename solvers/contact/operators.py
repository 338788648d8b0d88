"""The contact operators by name: each makes the `Coupling` of a slave surface with a master surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from stickslip.geometry.surfaces.surface import Surface
from stickslip.solvers.contact.coupling import Coupling
from stickslip.solvers.contact.mortar import mortar_coupling
from stickslip.solvers.contact.node_to_facet import nodal_coupling

Operator = Callable[[Surface, Surface, float], Coupling]  # slave, master, reach [m]: farthest gap looked across

OPERATORS: Mapping[str, Operator] = {
    "mortar": mortar_coupling,
    "node-to-segment": nodal_coupling,
    "node-to-face": nodal_coupling,
}
