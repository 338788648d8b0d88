"""Names of the numbers of a step, as error estimates, cost tables and closed forms use them."""

from __future__ import annotations

from collections.abc import Collection

CONTACT_NUMBERS = (
    "normal_force", "tangential_force", "max_pressure", "contact_area", "stick_area", "slip_area", "max_penetration",
    "max_slip", "dissipation", "dissipation_total",
)  # fmt: skip
MOVES, TURNS = ("displacement", "force"), ("rotation", "moment")
ENERGIES = ("external", "stored", "contact", "compliance", "dissipated", "time_remainder")
KINDS = {  # of numbers that have one unit and one scale
    "force": ("force", "normal_force", "tangential_force", "tension"),
    "moment": ("moment",),
    "area": ("contact_area", "stick_area", "slip_area"),
    "pressure": ("max_pressure", "stress"),
    "length": ("displacement", "max_penetration", "max_slip"),
    "dissipation": ("dissipation", "dissipation_total", "dissipated"),
    "energy": ("external", "stored", "contact", "compliance"),
    "rotation": ("rotation",),
}
KIND = {quantity: kind for kind, quantities in KINDS.items() for quantity in quantities}
STRESSES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}


def names(
    dim: int,
    contacts: Collection[str] = (),
    supports: Collection[str] = (),
    obstacles: Collection[str] = (),
    probes: Collection[str] = (),
    springs: Collection[str] = (),
    remote_points: Collection[str] = (),
    bolts: Collection[str] = (),
    elastic_support: Collection[str] = (),
) -> tuple[str, ...]:
    """Names of all numbers of a scene with these contacts, supports, obstacles, probes, springs and so on.

    >>> names(2, contacts=["base"])[:2], names(2, probes=["tip"])[:2]
    (('base.normal_force', 'base.tangential_force'), ('probe.tip.displacement.x', 'probe.tip.displacement.y'))
    """
    axes = "xyz"[:dim]
    turns = axes if dim == 3 else "z"
    return (
        *(f"{name}.{key}" for name in contacts for key in CONTACT_NUMBERS),
        *(f"probe.{name}.displacement.{a}" for name in probes for a in axes),
        *(f"probe.{name}.stress.{ij}" for name in probes for ij in STRESSES),
        *(f"support.{name}.force.{a}" for name in supports for a in axes),
        *(f"support.{name}.moment.{a}" for name in supports for a in turns),
        *(f"elastic_support.{name}.force.{a}" for name in elastic_support for a in axes),
        *(f"elastic_support.{name}.moment.{a}" for name in elastic_support for a in turns),
        *(f"obstacle.{name}.{key}.{a}" for name in obstacles for key in MOVES for a in axes),
        *(f"obstacle.{name}.moment.{a}" for name in obstacles for a in turns),
        *(f"spring.{name}.force.{a}" for name in springs for a in axes),
        *(f"bolt.{name}.tension" for name in bolts),
        *(f"remote_point.{name}.{key}.{a}" for name in remote_points for key in MOVES for a in axes),
        *(f"remote_point.{name}.{key}.{a}" for name in remote_points for key in TURNS for a in turns),
        *(f"energy.{key}" for key in ENERGIES),
    )
