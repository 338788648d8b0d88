"""history.png: prescribed values, contact forces, stick and slip areas, and energies over time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_type_hints

import numpy as np
from matplotlib.patches import Patch

from stickslip.geometry.amplitude import value_at
from stickslip.geometry.arrays import ROUNDING, Array
from stickslip.geometry.builders.builder import modelled
from stickslip.geometry.keys import Key
from stickslip.geometry.obstacles.obstacle import AXES
from stickslip.geometry.units import Units
from stickslip.solvers.results.step_result import SLIP, STICK
from stickslip.solvers.scene.scene import Scene
from stickslip.solvers.scene.timeline import Place
from stickslip.workflows.formats.csv_tables import column, is_prescribed
from stickslip.workflows.pictures.force_displacement import FEW, Columns, from_rest, per_metre
from stickslip.workflows.pictures.sheet import CURVES, INK, PALE, STATUS_COLOURS, STATUS_WORDS, Sheet, frame

MOST = 6  # largest number of curves in a panel
LEFT, HIGH, PITCH = 0.85, 1.4, 1.62  # of a panel [inch]
PANELS = {  # by what is prescribed
    "displacement": "motion [m]",
    "rotation": "rotation [rad]",
    "pressure": "load [Pa]",
    "traction": "load [Pa]",
    "bound": "friction bound [Pa]",
    "mu": "coefficient of friction [-]",
    "gap_offset": "gap offset [m]",
    "acceleration": "gravity [m/s²]",
}
ENERGIES = {  # by label
    "external work": "external",
    "elastic energy": "stored",
    "contact work": "contact",
    # the difference between dissipated energy and contact work shows whether the steps are small enough
    "dissipated (end of step)": "dissipated",
}
Curves = dict[str, Array]


def draw_history(folder: Path, scene: Scene, columns: Columns, title: str) -> Path:
    """Draw history.png.

    Args:
        columns: see `read_steps_table`.

    Raises:
        MachineError: the disk is full.
    """
    steps = from_rest(columns)
    everything, errors = list(panels_of(scene, steps)), errors_of(scene, steps)
    cut = f"; of many curves the {MOST} largest" if any(len(curves) > MOST for _, curves in everything) else ""
    panels = [(label, most(curves)) for label, curves in everything]
    panels = [(label, curves) for label, curves in panels if curves]
    count = len(panels) + bool(scene.pairs)
    sheet = Sheet(8.05, 1.15 + count * PITCH, units=scene.labels)
    place = (sheet.height - 0.75 - HIGH - k * PITCH for k in range(count))
    drawn: list[Any] = []
    for label, curves in panels:
        axes = _below(sheet, next(place), drawn, label)
        axes.axhline(0.0, color=PALE, linewidth=0.5)
        marked = {"marker": "o", "markersize": 2.0} if len(steps["time"]) <= FEW else {}
        for (name, values), colour in zip(curves.items(), CURVES, strict=False):
            axes.plot(steps["time"], values, color=colour, linewidth=1.3, label=name, **marked)
            if (error := errors.get((label, name))) is not None:
                axes.fill_between(steps["time"], values - error, values + error, color=colour, alpha=0.25, linewidth=0)
        _legend(axes)
    if scene.pairs:
        _areas(_below(sheet, next(place), drawn, f"contact area [{area(scene)}]"), scene, steps)
    for axes in drawn:
        axes.set_xlim(0.0, steps["time"][-1])
        frame(axes, "top", "right")
        axes.tick_params(labelbottom=axes is drawn[-1])
    sheet.figure.align_ylabels(drawn)
    drawn[-1].set_xlabel("time [s]", fontsize=9, color=INK)
    shaded = "; shaded: ± error" if errors else ""
    part = modelled(vars(scene.geometry), scene.model)
    side = f"surface of the modelled {part}" if part else "surface"
    sheet.head(title, f"{len(columns['time'])} steps; forces on contacts act on the {side}{cut}{shaded}", LEFT)
    return sheet.save(folder / "history.png")


def panels_of(scene: Scene, steps: Columns) -> Iterator[tuple[str, Curves]]:
    """Label and curves of each panel: prescribed values by unit, contact forces, energies."""
    force = per_metre(scene, "N")
    panels = PANELS | {"force": f"load [{force}]"}
    prescribed: dict[str, Curves] = {}
    for place, at_rest in _driven(scene):
        axis = place.component if place.component in ("x", "y", "z", "normal") else ""
        label = ", ".join(word for word in (place.name, axis) if word)
        curve = np.concatenate([[at_rest], steps[column(place)][1:]])
        key = place.component if place.quantity == "friction" else place.quantity
        known = key in panels and (place.table not in scene.sections or place.table == "gravity")
        panel = panels[key] if known else _panel_of_effect(scene, place)
        curves = prescribed.setdefault(panel, {})
        curves[f"{place.table.removesuffix('s')} {label}" if label in curves else label] = curve
    yield from prescribed.items()
    found: Curves = {}
    for name, contact in scene.pairs.items():
        found[f"{name}, normal"] = steps[f"{name}.normal_force"]
        for axis in "xyz"[: scene.dim] if contact.friction is not None else "":
            found[f"{name}, tangential {axis}"] = steps[f"{name}.tangential_force.{axis}"]
    force_panel, energy_panel = _results(scene)
    yield force_panel, found
    yield energy_panel, {label: steps[f"energy.{key}"] for label, key in ENERGIES.items()}


def _results(scene: Scene) -> tuple[str, str]:
    """Labels of the panels of contact forces and energies."""
    return f"contact force [{per_metre(scene, 'N')}]", f"energy [{per_metre(scene, 'J')}]"


def errors_of(scene: Scene, steps: Columns) -> dict[tuple[str, str], Array]:
    """Total errors of normal forces and energies, by panel and curve; those that are not known are left out."""
    contact, energy = _results(scene)
    columns = {(contact, f"{name}, normal"): f"{name}.normal_force" for name in scene.pairs}
    columns |= {(energy, label): f"energy.{key}" for label, key in ENERGIES.items()}
    found = {label: steps.get(f"{key}.error", np.array([np.nan])) for label, key in columns.items()}
    return {label: error for label, error in found.items() if np.isfinite(error).any()}


def _panel_of_effect(scene: Scene, place: Place) -> str:
    """Quantity and unit of a value in time that an effect's table declares."""
    table = scene.effect_tables()[place.table, place.name]
    hints = get_type_hints(type(table), include_extras=True)
    unit = next(part.unit for part in get_args(hints[place.quantity]) if isinstance(part, Key))
    return f"{place.quantity} [{per_metre(scene, unit) if unit in ('N', 'N m') else unit}]"


def _driven(scene: Scene) -> Iterator[tuple[Place, float]]:
    """Prescribed values, and motions of obstacles (prescribed or driven by forces), each with its value at t = 0."""
    for place, amplitude in scene.drives().items():
        if is_prescribed(place):
            yield place, value_at(amplitude, 0.0, scene.steps.end)
    for name, obstacle in scene.obstacles.items():
        for axis in AXES[: scene.dim]:
            at_rest = value_at(obstacle.displacement.get(axis, 0.0), 0.0, scene.steps.end)
            yield Place("obstacles", name, "displacement", axis), at_rest


def most(curves: Curves) -> Curves:
    """The curves with the largest values, in their original order, without those that stay zero."""
    size = {name: float(np.abs(values).max()) for name, values in curves.items()}
    kept = sorted(size, key=lambda name: -size[name])[:MOST]
    least = ROUNDING * max(size.values(), default=0.0)
    return {name: values for name, values in curves.items() if name in kept and size[name] > least}


def area(scene: Scene) -> str:
    """Unit of contact areas: plane models report them per metre of thickness."""
    return "m" if scene.model.startswith("plane") else "m²"


def _areas(axes: Any, scene: Scene, steps: Columns) -> None:
    """Draw the sticking and the slipping area, summed over all contacts."""
    total = {
        s: np.sum([steps[f"{name}.{STATUS_WORDS[s]}_area"] for name in scene.pairs], axis=0) for s in (STICK, SLIP)
    }
    colours = [STATUS_COLOURS[s] for s in total]
    axes.stackplot(steps["time"][1:], *(values[1:] for values in total.values()), colors=colours, linewidth=0)
    axes.set_ylim(bottom=0.0)
    patches = [Patch(facecolor=STATUS_COLOURS[s], label=STATUS_WORDS[s]) for s in (SLIP, STICK)]
    _legend(axes, handles=patches)


def _below(sheet: Sheet, bottom: float, drawn: list[Any], label: str) -> Any:
    axes = sheet.axes(LEFT, bottom, 5.2, HIGH)
    axes.set_ylabel(label, fontsize=9, color=INK)
    drawn.append(axes)
    return axes


def _legend(axes: Any, **options: Any) -> None:
    look: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.01, 1.04), "fontsize": 8, "frameon": False}
    axes.legend(**look, handlelength=1.4, **options)


def draw_fit(path: Path, data: Columns, found: Columns, title: str, units: Units) -> Path:
    """Draw a history that was fitted over the data, a panel for each column.

    Args:
        data: by column, `time` among them.
        found: the same of the fit.

    Raises:
        MachineError: the disk is full.
    """
    names = [name for name in data if name != "time"]
    left, wide, high = 0.95, 5.0, 2.2  # [inch]
    sheet = Sheet(left + wide + 0.35, (high + 0.7) * len(names) + 0.75, units=units)
    sheet.head(title, "data, and the history that fits them best", 0.3)
    for number, name in enumerate(names, start=1):
        axes = sheet.axes(left, sheet.height - 0.75 - (high + 0.7) * number + 0.55, wide, high)
        axes.plot(data["time"], data[name], "o", color=CURVES[0], markersize=3, label="data")
        axes.plot(found["time"], found[name], color=CURVES[1], linewidth=1.4, label="fit")
        axes.set_xlabel("time [s]", fontsize=9, color=INK)
        axes.set_title(name, fontsize=9, loc="left", color=INK)
        axes.legend(fontsize=8, frameon=False)
        frame(axes, "top", "right")
    return sheet.save(path)
