"""A page of matplotlib with axes placed in inches, independent of layout engines and of matplotlib's global state."""

from __future__ import annotations

import io
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator, ScalarFormatter
from PIL import Image as Pillow

from stickslip.geometry.arrays import Array
from stickslip.geometry.units import SI, Units
from stickslip.solvers.results.step_result import OPEN, SLIP, STICK
from stickslip.workflows.formats.files import write_aside
from stickslip.workflows.pictures.view import Image, View

DPI = 200
LINE = 0.15  # from one line of a caption to the next [inch]
INK, PALE = "#222222", "#666666"
COLOURS = "viridis"
RAISED = str.maketrans("0123456789-−", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁻")
# curves that colour-blind readers can tell apart
CURVES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6d31", "#7f7f7f")
STATUS_COLOURS = {OPEN: "#d9d9d9", SLIP: "#e6862d", STICK: "#2f6db3"}
STATUS_WORDS = {OPEN: "open", SLIP: "slip", STICK: "stick"}


class Sheet:
    """A white page of width × height inches; labels are written with units of the SI, and shown with the scene's."""

    def __init__(self, width: float, height: float, dpi: int = DPI, units: Units = SI) -> None:
        self.width, self.height, self.dpi, self.units = width, height, dpi, units
        self._titles: list[Any] = []  # the user's words
        self.figure = Figure(figsize=(width, height), dpi=dpi, facecolor="white")
        self.canvas = FigureCanvasAgg(self.figure)

    def axes(self, left: float, bottom: float, width: float, height: float, **options: Any) -> Any:
        """Axes by their place in inches."""
        place = (left / self.width, bottom / self.height, width / self.width, height / self.height)
        axes = self.figure.add_axes(place, **options)
        axes.tick_params(labelsize=8, color=PALE, labelcolor=INK)
        return axes

    def write(self, x: float, y: float, text: str, **options: Any) -> Any:
        """Text at a place in inches."""
        look: dict[str, Any] = {"fontsize": 8, "color": INK, "va": "baseline", "parse_math": False} | options
        return self.figure.text(x / self.width, y / self.height, text, **look)

    def head(self, title: str, caption: str, left: float) -> None:
        """Title in one line, or smaller in two lines, and lines of a caption below it; left: margin [inch]."""
        room = self.width - left - 0.1
        lines = wrap(title, int(room * 17), max_lines=2, placeholder="…")
        place, size = (0.34, 8.0) if len(lines) > 1 else (0.28, 11.0)
        look = {"fontsize": size, "fontweight": "bold", "linespacing": 1.15}
        self._titles.append(self.write(left, self.height - place, "\n".join(lines), **look))
        self._shrink(self._titles[-1], room)
        for index, line in enumerate(caption.split("\n")):
            self._shrink(self.write(left, self.height - 0.48 - index * LINE, line, color=PALE), room)

    def _shrink(self, text: Any, room: float) -> None:
        """Make a text that is wider than the room [inch] as small as it needs to be."""
        canvas: Any = self.canvas
        wide = text.get_window_extent(canvas.get_renderer()).width / self.dpi
        text.set_fontsize(text.get_fontsize() * room / max(wide, room))

    def colour_bar(self, axes: Any, norm: Normalize, label: str, orientation: str, beyond: str = "neither") -> None:
        """Colour bar that fills the axes; orientation: horizontal or vertical; beyond: "max" if values are larger."""
        mappable = ScalarMappable(norm, COLOURS)
        logarithmic = isinstance(norm, LogNorm)
        form: dict[str, Any] = {} if logarithmic else {"format": Numbers()}
        bar: Any = self.figure.colorbar(mappable, cax=axes, orientation=orientation, extend=beyond, **form)
        bar.ax.tick_params(labelsize=8, color=PALE, labelcolor=INK)
        bar.ax.xaxis.get_offset_text().set_fontsize(8)
        bar.ax.yaxis.get_offset_text().set_fontsize(8)
        bar.outline.set_linewidth(0.5)
        bar.ax.tick_params(which="minor", color=PALE)
        if not logarithmic:
            bar.locator = ticks(5)
            bar.update_ticks()
        bar.set_label(label, fontsize=9, color=INK)

    def status_legend(self, axes: Any, **options: Any) -> None:
        """Legend of the three colours of the contact status."""
        patches = [
            Patch(facecolor=STATUS_COLOURS[s], edgecolor=PALE, linewidth=0.5, label=STATUS_WORDS[s])
            for s in STATUS_COLOURS
        ]
        options = {"ncols": 3, "fontsize": 8, "frameon": False, "handlelength": 1.2, "columnspacing": 1.2} | options
        axes.legend(handles=patches, **options)

    def pixels(self) -> Image:
        """The page as it is now, as an image (rows, columns, 3)."""
        canvas: Any = self.canvas
        self._label()
        canvas.draw()
        return np.array(canvas.buffer_rgba())[..., :3]

    def save(self, path: Path) -> Path:
        """Write the page as PNG.

        Raises:
            MachineError: the disk is full.
        """
        self._label()
        content = io.BytesIO()
        # compressed by 6 of 9 a picture takes half as long again, and is a twelfth smaller
        Pillow.fromarray(self.pixels()).save(content, "PNG", dpi=(self.dpi, self.dpi), compress_level=3)
        write_aside(path, content.getvalue())
        return path

    def _label(self) -> None:
        """Put the scene's units into all labels."""
        if self.units != SI:
            for text in self.figure.findobj(Text):
                if text not in self._titles:
                    text.set_text(self.units.label(text.get_text()))


def show_image(axes: Any, view: View, image: Image, labels: tuple[str, str] | None) -> None:
    """Put a rendered view into axes of the same aspect: with scales if `labels` are given, otherwise with a triad."""
    axes.imshow(image, extent=view.extent, aspect="auto", origin="upper")
    if labels is None:
        axes.set_axis_off()
        _triad(axes, view)
        return
    axes.set_xlabel(f"{labels[0]} [m]", fontsize=9, color=INK)
    axes.set_ylabel(f"{labels[1]} [m]", fontsize=9, color=INK)
    frame(axes)


def frame(axes: Any, *hidden: str) -> None:
    """Thin frame, few ticks, plain numbers."""
    for name, spine in axes.spines.items():
        spine.set_linewidth(0.6)
        spine.set_color(PALE)
        spine.set_visible(name not in hidden)
    inches = axes.get_window_extent().size / axes.figure.dpi
    for axis, length in ((axes.xaxis, inches[0]), (axes.yaxis, inches[1])):
        axis.set_major_locator(ticks(int(np.clip(length * 2.8, 2, 8))))
        axis.set_major_formatter(Numbers())
        axis.get_offset_text().set_fontsize(8)


class Numbers(ScalarFormatter):
    """0.25, or 2.5 with ×10⁸ at the end of the axis, never 250000000; no mathtext, whose layout takes long."""

    def __init__(self) -> None:
        super().__init__(useMathText=False, useOffset=False)
        self.set_powerlimits((-3, 4))

    def get_offset(self) -> str:
        """The power of ten.

        >>> numbers = Numbers()
        >>> numbers.create_dummy_axis()
        >>> numbers.axis.set_view_interval(0.0, 2e8)
        >>> numbers.set_locs([0.0, 1e8, 2e8])
        >>> numbers.get_offset()
        '×10⁸'
        """
        found: str = super().get_offset()
        _, e, power = found.partition("1e")
        return f"×10{power.translate(RAISED)}" if e else found


def ticks(count: int) -> MaxNLocator:
    """Place so many round numbers on an axis, at most."""
    return MaxNLocator(count, steps=[1, 2, 2.5, 5, 10])


def span(values: Array, at_least: float = 0.0) -> Normalize:
    """Range of colours from 0, or the smallest value if negative, to the largest; of width 1 if these are equal."""
    low, high = min(0.0, float(values.min(initial=0.0))), max(at_least, float(values.max(initial=0.0)))
    return Normalize(low, high if high > low else low + 1.0)


def _triad(axes: Any, view: View) -> None:
    """The directions x, y, z in the lower left corner."""
    inset = axes.inset_axes((0.0, 0.0, 0.16, 0.16 * view.aspect))
    inset.set_axis_off()
    inset.set_aspect("equal")
    inset.set_xlim(-1.3, 1.3)
    inset.set_ylim(-1.3, 1.3)
    for i, name in enumerate("xyz"):
        tip = np.array([view.right[i], view.up[i]])
        inset.annotate("", tip, (0, 0), arrowprops={"arrowstyle": "-|>", "color": INK, "lw": 0.9, "mutation_scale": 6})
        inset.text(*(1.28 * tip), name, fontsize=8, ha="center", va="center", color=INK)


def decades(values: Array) -> LogNorm:
    """Range of colours from the smallest value to the largest, one to three powers of ten; up to 1 if all are 0."""
    high = float(values.max(initial=0.0)) or 1.0
    low = float(np.clip(values.min(initial=high), high / 1000, high / 10))
    return LogNorm(low, high)
