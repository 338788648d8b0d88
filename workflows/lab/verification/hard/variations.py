"""The variations: each is a function of a scene's tables, and says itself where it does not apply.

Loads close to a limit: gravity turned sideways, to a share of the angle at which floating bodies cease to rest.

A scene of boxes seen in a mirror: x goes to the other end of the box, and left is right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from stickslip import NoEquilibriumError, StickslipError
from stickslip.geometry.amplitude import Amplitude, value_at
from stickslip.solvers.scene.timeline import Place
from stickslip.solvers.simulation.resolve import resolve
from stickslip.workflows.lab.verification.hard.tables import (
    COUNT,
    Tables,
    corners,
    extent,
    frictions,
    lasting,
    over_drives,
    resolved,
    scaled,
    sizes,
    softest,
    stiffen,
    times,
    travel,
)
from stickslip.workflows.lab.verification.prepared import prepare
from stickslip.workflows.lab.verification.units import Units, convert
from stickslip.workflows.scene_file.read import from_dict, to_dict

Random = np.random.Generator
BOXES = ("block", "strip", "stack", "two_blocks")
OTHER = {"left": "right", "right": "left", "aging": "slip", "slip": "aging"}


def mirrored(tables: Tables, random: Random) -> Tables | None:
    """The mirror image, meshed by a grid, for only a grid is its own image; None if the shape is not its own image."""
    shape = tables["geometry"]
    if shape.get("builder") not in BOXES or shape.get("offset", 0.0) != 0.0:
        return None
    if "body_force" in tables or any("moment" in point for point in tables.get("remote_points", {}).values()):
        return None  # may be an expression; turns with the axes
    if any("height" in obstacle for obstacle in tables.get("obstacles", {}).values()):
        return None  # an expression, or a file
    scene = from_dict(tables)
    ends = np.asarray(scene.geometry.box(scene.dim))[:, 0]
    middle = float(ends.min() + ends.max())
    found = over_drives(tables, _turned)
    found["geometry"]["cells"] = "tensor"
    for contact in found["contacts"].values():
        shear = (contact.get("initial") or {}).get("traction")
        if isinstance(shear, list):
            shear[0] *= -1
        elif shear and _other(contact["surface"]) == contact["surface"]:  # it is not steep
            contact["initial"]["traction"] = -shear
        contact |= {key: _other(contact[key]) for key in ("surface", "against") if key in contact}
        _mirror(contact.get("friction") or {}, middle)
    for body in found["bodies"].values():
        for key in {"axis_1", "axis_2"} & body.keys():
            body[key][0] *= -1
    for table in ("supports", "loads", "probes", "obstacles", "springs", "bolts", "remote_points"):
        for entry in found.get(table, {}).values():
            _mirror(entry, middle)
    for pair in found.get("periodic", {}).values():
        pair["boundary"], pair["with"] = _other(pair["boundary"]), _other(pair["with"])
    return found


def _turned(place: Place, amplitude: Amplitude) -> Amplitude:
    """Mirror a number: along x, and of turns, it has the other sign."""
    return scaled(amplitude, -1.0) if place.component == "x" or place.quantity == "rotation" else amplitude


def _mirror(entry: dict[str, Any], middle: float) -> None:
    for key in ("boundary", "at", "to", "head", "nut"):
        if isinstance(entry.get(key), str):
            entry[key] = _other(entry[key])
    for table in (entry, entry.get("rotation") or {}):
        if "point" in table:
            table["point"][0] = middle - table["point"][0]
    for key in ("normal", "axis", "direction"):
        if entry.get(key) is not None:
            entry[key][0] *= -1


def _other(side: Any) -> Any:
    """
    >>> _other("block.left"), _other(["block.top", "left"])  # "left" is an obstacle, which is where its point is
    ('block.right', ['block.top', 'left'])
    """
    if isinstance(side, list):
        return [_other(each) for each in side]
    body, dot, name = side.rpartition(".")
    return f"{body}{dot}{OTHER.get(name, name) if dot else name}"


STEEPEST = 2.0  # of the vertical component; bodies that rest even there have no limit
HALVINGS = 14  # of the bracket


def sideways(share: float, tables: Tables, random: Random) -> Tables | None:
    """After its end, gravity also grows sideways, to this share of its vertical component; None without gravity."""
    if "gravity" not in tables:
        return None
    end, acceleration = tables["steps"]["end"], tables["gravity"]["acceleration"]
    down = value_at(_tuple(acceleration[-1]), end, end)
    acceleration[0] = [[0.0, 0.0], [end, 0.0], [2 * end, share * abs(down)]]
    tables["steps"] = lasting(tables["steps"], 2 * end, 2 * tables["steps"]["count"])
    return tables


def near_limit(factor: float, tables: Tables, random: Random) -> Tables | None:
    """`sideways` to this factor of its limit, which is bracketed by limit analysis; None if there is none."""
    steepest = sideways(STEEPEST, deepcopy(tables), random)
    if steepest is None or not resolve(from_dict(tables)).rigid_modes.shape[1] or not _falls(steepest):
        return None
    low, high = 0.0, STEEPEST
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        trial = sideways(middle, deepcopy(tables), random)
        assert trial is not None
        low, high = (low, middle) if _falls(trial) else (middle, high)
    return sideways(factor * (low if factor < 1 else high), tables, random)


def _falls(tables: Tables) -> bool:
    """Whether it is proved that the bodies cannot rest under the loads of the end; one iteration is enough."""
    gravity = tables["gravity"]["acceleration"]
    end = tables["steps"]["end"]
    tables["gravity"]["acceleration"] = [value_at(_tuple(a), end, end) for a in gravity]
    tables["steps"] = lasting(tables["steps"], end, 1)
    scene = from_dict(tables)
    try:
        list(prepare(replace(scene, solver=replace(scene.solver, max_iterations=1))).steps())
    except NoEquilibriumError:
        return True
    except StickslipError:
        return False
    return False


def _tuple(value: float | list[list[float]]) -> float | tuple[tuple[float, float], ...]:
    return float(value) if np.isscalar(value) else tuple((t, v) for t, v in value)  # type: ignore[union-attr,arg-type]


Change = Callable[[Tables, Random], Tables | None]  # None: does not apply; it may work on the tables it is given


@dataclass(frozen=True)
class Scale:
    """One metre and one newton of the varied scene, in units of its twin."""

    length: float = 1.0
    force: float = 1.0


@dataclass(frozen=True)
class Variation:
    """A change of a scene, and if its answer is known from that of another scene, its twin."""

    kind: str
    name: str
    change: Change
    twin: Change | None = None  # the scene whose answer is the same
    scale: Scale = Scale()  # up to these factors


def varied(tables: Tables, change: Change, random: Random) -> Tables | None:
    """The changed scene; None if the change does not apply or changes nothing."""
    found = change(deepcopy(tables), random)
    return None if found is None or found == tables else found


def same(tables: Tables, random: Random) -> Tables | None:
    """The scene itself."""
    return tables


# friction and normal laws


RATED: dict[str, tuple[float, ...]] = {  # keys of rate and state, of initial tractions and of clocks, times these
    "a": (0.5, 1.4), "b": (0.5, 1.2), "f0": (0.5, 1.5), "Dc": (0.7, 3, 100), "damping": (0.1, 10),
    "pressure": (1.5,), "traction": (0.9,), "state": (0.1, 1e3), "rate": (0.1, 10),
    "error": (0.1, 10), "largest": (0.1,),
}  # fmt: skip
JUMPS = ("stick", "tresca")  # laws whose bound jumps where surfaces part


def times_mu(factor: float, tables: Tables, random: Random) -> Tables | None:
    for friction in frictions(tables, "mu"):
        friction["mu"] = times(friction["mu"], factor)
    return tables


def friction_law(law: str, tables: Tables, random: Random) -> Tables | None:
    """Another friction law in its place, of bounds that the scene may reach; or none.

    Tresca's bound and stick come with bilateral contact: where surfaces part the bound jumps, and there may be no
    solution. None of them has a rate: equal steps come in place of a clock, and initial tractions have no state.
    """
    if not any(frictions(tables)):
        return None
    bound = 0.1 * softest(tables) * travel(tables) / extent(tables)
    laws = {
        "stick": {"law": "stick"},
        "tresca": {"law": "tresca", "bound": bound},
        "capped": {"law": "capped_coulomb", "mu": 0.5, "s_max": bound},
    }
    if tables["steps"].pop("clock", None):
        tables["steps"]["count"] = COUNT
    for contact in tables["contacts"].values():
        if contact.pop("friction", None) and law != "none":
            contact["friction"] = laws[law]
            if law in JUMPS:
                contact["normal"] = {"law": "bilateral"}
        for key in ("state", "rate", *(["traction"] if law == "none" else [])):
            contact.get("initial", {}).pop(key, None)
    return tables


def compliant(stiffness: float, m_n: float, tables: Tables, random: Random) -> Tables | None:
    """Compliant contact; stiffness: of the surface over that of the bodies, at a penetration of the travel."""
    if any(friction["law"] in JUMPS for friction in frictions(tables)) or tables["steps"].get("clock"):
        return None
    own = softest(tables) / extent(tables)
    for contact in tables["contacts"].values():
        contact["normal"] = {"law": "compliance", "c_n": stiffness * own * travel(tables) ** (1 - m_n), "m_n": m_n}
    return tables


def elastic_friction(stiffness: float, tables: Tables, random: Random) -> Tables | None:
    """Tangential stiffness before slip, in units of that of the bodies."""
    for friction in frictions(tables):
        if "Dc" in friction:  # slips at all tractions
            return None
        friction["k_T"] = stiffness * softest(tables) / extent(tables)
    return tables


def normal_law(law: str, tables: Tables, random: Random) -> Tables | None:
    for contact in tables["contacts"].values():
        contact["normal"] = {"law": law}
        if law == "tied":
            contact.pop("friction", None)
            contact.pop("initial", None)
    return tables


def rated(key: str, change: Callable[[Any], Any], tables: Tables, random: Random) -> Tables | None:
    """Change a number of friction by rate and state, of what it starts from, or of the clock."""
    parts = [part for c in tables["contacts"].values() for part in (c.get("friction", {}), c.get("initial", {}))]
    found = [part for part in (*parts, tables["steps"].get("clock", {})) if key in part]
    for part in found:
        part[key] = change(part[key])
    return tables if found else None


# materials


def poisson(nu: float, order: int, tables: Tables, random: Random) -> Tables | None:
    for body in tables["bodies"].values():
        if "nu" not in body:  # orthotropic
            return None
        body["nu"] = nu
    tables["geometry"]["order"] = order
    return tables


def contrast(place: str, factor: float, tables: Tables, random: Random) -> Tables | None:
    """The moduli of one body times a factor: the first, the last, or one in the middle if there are three or more."""
    names = list(tables["bodies"])
    if (place == "middle" and len(names) < 3) or (place == "last" and len(names) < 2):
        return None
    stiffen(tables["bodies"][names[{"first": 0, "middle": len(names) // 2, "last": -1}[place]]], factor)
    return tables


# geometry and mesh


def slender(tall: bool, tables: Tables, random: Random) -> Tables | None:
    """Boxes 20 times as long as high, or as high as long, with two rows of cells; points move with them."""
    shape = tables["geometry"]
    if shape.get("builder") not in BOXES:
        return None
    axis, (grown, other) = (1, ("height", "length")) if tall else (0, ("length", "height"))
    ratio = 20 * shape[other] / shape[grown]
    for key in (grown, f"lower_{grown}"):
        if key in shape:
            shape[key] *= ratio
    factor = shape[other] / 2 / shape["mesh_size"]
    for key in sizes(tables):
        shape[key] *= factor
    shape.pop("contact_mesh_size", None)
    last = axis if tables["model"] != "3d" or axis == 0 else 2
    for table in ("supports", "probes"):
        for entry in tables[table].values():
            if "point" in entry:
                entry["point"][last] *= ratio
    return tables


def other_mesh(tables: Tables, random: Random) -> Tables | None:
    """Every mesh size times a random factor of its own."""
    for key in sizes(tables):
        tables["geometry"][key] *= float(random.uniform(0.75, 1.25))
    return tables


def mesh_contrast(factor: float, tables: Tables, random: Random) -> Tables | None:
    """Cells of the second body finer or coarser than those of the first one."""
    shape = tables["geometry"]
    keys = [key for key in ("lower_mesh_size", "inner_mesh_size") if key in shape]
    if "mesh_ratio" in shape:
        shape["mesh_ratio"] = factor
        return tables
    if not keys:
        return None
    shape[keys[0]] = shape["mesh_size"] * factor
    return tables


def set_key(table: str, key: str, value: object, tables: Tables, random: Random) -> Tables | None:
    tables[table][key] = value
    return tables


def model(name: str, tables: Tables, random: Random) -> Tables | None:
    if tables["model"] != "plane strain":
        return None
    tables["model"] = name
    return tables


def gap(share: float, tables: Tables, random: Random) -> Tables | None:
    """A gap, or an interference, of a share of the travel."""
    for contact in tables["contacts"].values():
        contact["gap_offset"] = contact.get("gap_offset", 0.0) + share * travel(tables)
    return tables


def contact_key(key: str, value: object, tables: Tables, random: Random) -> Tables | None:
    """A key of contacts between bodies."""
    partners = [(c, {*np.atleast_1d(c.get("against") or [])}) for c in tables["contacts"].values()]
    pairs = [contact for contact, others in partners if others.isdisjoint(tables.get("obstacles", {}))]
    for contact in pairs:
        contact[key] = value
    return tables if pairs else None


# loads and time


def times_loads(factor: float, tables: Tables, random: Random) -> Tables:
    """Every prescribed motion and load times a factor."""
    return over_drives(tables, lambda _, a: scaled(a, factor))


def one_step(tables: Tables, random: Random) -> Tables | None:
    """As few steps as the tables in time allow, or a clock that only its error holds back."""
    return rated("largest", (1e3).__mul__, tables, random) or set_key("steps", "count", 1, tables, random)


def at_once(tables: Tables, random: Random) -> Tables | None:
    """One big step: every value goes straight to where it is at the end; not where rates matter."""
    end = tables["steps"]["end"]
    if tables["steps"].get("clock"):
        return None
    tables["steps"]["count"] = 1
    return over_drives(tables, lambda _, a: value_at(a, end, end), bounds=True)


def goes_on(share: float, tables: Tables, random: Random) -> Tables | None:
    """After the end, the last ramp goes back, to `share` times its own size on the other side of where it began."""
    end, times = tables["steps"]["end"], corners(tables)
    before = times[-2] if len(times) > 1 else 0.0
    later = 2 * end - before

    def turned(place: Place, a: Amplitude) -> Amplitude:
        start, last = value_at(a, before, end), value_at(a, end, end)
        return (*resolved(a, end, times), (later, start - share * (last - start)))

    found = over_drives(tables, turned)
    found["steps"] = lasting(tables["steps"], later, max(2, tables["steps"]["count"]))
    return found


def all_back(tables: Tables, random: Random) -> Tables | None:
    """After the end, everything returns to where it was at t = 0."""
    end, times = tables["steps"]["end"], corners(tables)
    found = over_drives(tables, lambda _, a: (*resolved(a, end, times), (2 * end, value_at(a, 0.0, end))))
    found["steps"] = lasting(tables["steps"], 2 * end, max(2, tables["steps"]["count"]))
    return found


def slower(factor: float, tables: Tables, random: Random) -> Tables | None:
    """The same history in another unit of time, rates and all."""
    return in_units(1.0, 1.0, tables, random, factor)


# solution


def method(name: str, surface: str, tables: Tables, random: Random) -> Tables | None:
    """Another method, with as many iterations as the slowest of them takes."""
    tables["solver"] |= {"method": name, "surface": surface, "max_iterations": 50_000}
    return tables


# units


def in_units(length: float, force: float, tables: Tables, random: Random, time: float = 1.0) -> Tables | None:
    """The same bodies and loads in other units, those of gravity and of a length of thickness included."""
    scene = from_dict(tables)
    if "file" in tables["geometry"] and length != 1.0:
        return None
    return to_dict(convert(scene, Units(length=length, force=force, plane=scene.model.startswith("plane"), time=time)))


def units(name: str, length: float, force: float) -> Variation:
    return Variation("units", name, partial(in_units, length, force), same, Scale(length, force))


# all of them


def _of_laws_and_bodies() -> Iterator[Variation]:
    yield Variation("as it is", "as it is", same)
    for factor in (0.001, 0.01, 0.1, 0.5, 2, 10, 100, 1000):
        yield Variation("mu", f"mu x {factor:g}", partial(times_mu, factor))
    for law in ("none", "stick", "tresca", "capped"):
        yield Variation("law", f"friction {law}", partial(friction_law, law))
    for law in ("bilateral", "tied"):
        yield Variation("law", law, partial(normal_law, law))
    for stiffness, m_n in ((1e-3, 1.0), (1.0, 1.0), (1e6, 1.0), (1e-3, 2.0), (1e6, 2.0)):
        yield Variation("compliance", f"c_n {stiffness:g} m_n {m_n:g}", partial(compliant, stiffness, m_n))
    for stiffness in (1e-12, 1e-3, 1e6):
        yield Variation("compliance", f"k_T {stiffness:g}", partial(elastic_friction, stiffness))
    for nu, order in ((0.4999, 1), (0.4999, 2), (0.0, 1)):
        yield Variation("nu", f"nu {nu:g} order {order}", partial(poisson, nu, order))
    for place in ("first", "middle", "last"):
        for factor in (1e-6, 1e-4, 1e-2, 1e2, 1e4, 1e6):
            yield Variation("contrast", f"E of {place} x {factor:g}", partial(contrast, place, factor))
    yield Variation("aspect", "20 times as long", partial(slender, False))
    yield Variation("aspect", "20 times as high", partial(slender, True))


def _of_rates() -> Iterator[Variation]:
    for key, factors in RATED.items():
        for factor in factors:
            yield Variation(f"rates: {key}", f"{key} x {factor:g}", partial(rated, key, partial(times, factor=factor)))
    yield Variation(
        "rates: law", "other evolution", partial(rated, "evolution", {"aging": "slip", "slip": "aging"}.get)
    )


def _of_meshes_and_loads() -> Iterator[Variation]:
    for k in range(3):
        yield Variation("mesh", f"random mesh {k + 1}", other_mesh)
    yield Variation("mesh", "second body finer", partial(mesh_contrast, 0.25))
    yield Variation("mesh", "second body coarser", partial(mesh_contrast, 3.0))
    yield Variation("mesh", "order 2", partial(set_key, "geometry", "order", 2))
    yield Variation("mesh", "order 1", partial(set_key, "geometry", "order", 1))
    yield Variation("mesh", "tensor", partial(set_key, "geometry", "cells", "tensor"))
    yield Variation("mesh", "simplex", partial(set_key, "geometry", "cells", "simplex"))
    yield Variation("law", "plane stress", partial(model, "plane stress"))
    for share in (0.3, 1e-6, -1e-6, -0.3):
        yield Variation("gap", f"{'gap' if share > 0 else 'interference'} {abs(share):g}", partial(gap, share))
    for factor in (1e-6, 0.01, 10):
        yield Variation("loads", f"loads x {factor:g}", partial(times_loads, factor))
    yield Variation("steps", "one step", one_step)
    yield Variation("steps", "one big step", at_once)
    yield Variation("steps", "reversed", partial(goes_on, 1.0))
    yield Variation("steps", "everything back", all_back)
    for share in (0.2, 0.5):
        yield Variation("limit", f"gravity sideways {share:g}", partial(sideways, share))
    for factor in (0.999, 1.001):
        yield Variation("limit", f"{factor:g} of the limit sideways", partial(near_limit, factor))


def _of_methods_and_units() -> Iterator[Variation]:
    yield Variation("operator", "node by node", _node_by_node)
    yield Variation("operator", "sliding", partial(contact_key, "sliding", True))
    yield Variation("solver", "tolerance 1e-11", partial(set_key, "solver", "tolerance", 1e-11))
    yield Variation("solver", "tolerance 1e-4", partial(set_key, "solver", "tolerance", 1e-4))
    for name in ("surface-uzawa", "nsgs", "uzawa", "perturbed-lagrangian"):
        yield Variation("solver", name, partial(method, name, "auto"))
    yield Variation("solver", "matrix-free", partial(method, "surface-uzawa", "matrix-free"))
    yield units("mm, N", 1e3, 1.0)
    for power in (12, -12):
        yield units(f"length x 1e{power}", 10.0**power, 1.0)
        yield units(f"force x 1e{power}", 1.0, 10.0**power)
    yield Variation("symmetry", "time x 1000", partial(slower, 1000.0), same)
    yield Variation("symmetry", "mirrored", mirrored, _by_a_grid)


def _node_by_node(tables: Tables, random: Random) -> Tables | None:
    name = "node-to-face" if tables["model"] == "3d" else "node-to-segment"
    return contact_key("operator", name, tables, random)


def _by_a_grid(tables: Tables, random: Random) -> Tables | None:
    tables["geometry"]["cells"] = "tensor"
    return tables


FIXED = {
    variation.name: variation
    for variation in (*_of_laws_and_bodies(), *_of_rates(), *_of_meshes_and_loads(), *_of_methods_and_units())
}
MIXED = tuple(
    v for v in FIXED.values() if v.twin is None and v.kind not in ("solver", "limit", "as it is")
)  # what random ones combine
MOST = 3  # of them in a random variation


def variation(name: str) -> Variation:
    """By its name: a fixed one, or "random 7", which combines some of the fixed ones with random numbers."""
    return FIXED.get(name) or Variation("random", name, _mixed)


def _mixed(tables: Tables, random: Random) -> Tables | None:
    """Random numbers first, then one to `MOST` variations of different kinds, those that apply."""
    found = other_mesh(_other_numbers(tables, random), random)
    kinds: set[str] = set()
    for index in random.permutation(len(MIXED)):
        one = MIXED[index]
        changed = None if one.kind in kinds or found is None else varied(found, one.change, random)
        if changed is None:
            continue
        found = changed
        kinds.add(one.kind)
        if len(kinds) >= 1 + random.integers(MOST):
            break
    return found


def _other_numbers(tables: Tables, random: Random) -> Tables:
    """Random mu, moduli, nu and loads."""
    for friction in frictions(tables, "mu"):
        mu, known = float(np.exp(random.uniform(math.log(0.02), math.log(3.0)))), friction["mu"]
        friction["mu"] = times(known, mu / max(value for _, value in known)) if isinstance(known, list) else mu
    for body in tables["bodies"].values():
        stiffen(body, float(10.0 ** random.uniform(-1.5, 1.5)))
        if "nu" in body:
            body["nu"] = float(random.uniform(0.0, 0.48))
    return times_loads(float(10.0 ** random.uniform(-1.0, 0.5)), tables, random)
