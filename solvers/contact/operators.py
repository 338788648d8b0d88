"""The contact operators by name: each makes the `Coupling` of a slave surface with a master surface."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from geometry.surfaces.surface import Surface
from solvers.contact.coupling import Coupling
from solvers.contact.mortar import mortar_coupling
from solvers.contact.node_to_facet import nodal_coupling

Operator = Callable[[Surface, Surface, float], Coupling]  # slave, master, reach [m]: farthest gap looked across

OPERATORS: Mapping[str, Operator] = {
    "mortar": mortar_coupling,
    "node-to-segment": nodal_coupling,
    "node-to-face": nodal_coupling,
}
