"""The terminal shows a run: progress while it works, a short table at the end."""

from __future__ import annotations

import sys
from collections.abc import Container, Iterable
from threading import Event, Thread
from time import monotonic
from typing import Any, Self

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from rich.text import Text

from stickslip.geometry.arrays import EXACT
from stickslip.geometry.errors import printable
from stickslip.geometry.units import Units
from stickslip.solvers.accuracy.budget import BETTER, COARSER, PAIRS, TIME
from stickslip.solvers.parallel.counters import Clock
from stickslip.solvers.results.step_result import StepResult
from stickslip.solvers.simulation.plan import warnings
from stickslip.solvers.simulation.simulation import Simulation
from stickslip.solvers.stepping.history import HistoryRow
from stickslip.workflows.formats.neglect_table import neglect_lines
from stickslip.workflows.formats.plus_minus import error_of, of_parts, stated, with_error
from stickslip.workflows.formats.results import NEGLECTED, error_budget, legend, listed
from stickslip.workflows.run.mesh_report import ContactReport, MeshReport
from stickslip.workflows.run.result import Outcome
from stickslip.workflows.run.watch import Watch
from stickslip.workflows.writers.writer import registered

Content = dict[str, Any]
ANNOUNCED = 5.0  # s; what takes longer is announced also where there is no terminal
SAID = {  # of phases, whatever is done in them
    "mesh": "meshing",
    "assemble": "assembling",
    "prepare": "factorising the bodies",
    "iterate": "solving",
    "error": "estimating errors",
    "audit": "auditing",
    "output": "writing",
    "linear_reference": "solving the linear reference",
}
PARTS_SAID = {  # parts of phases that are spoken of by themselves
    ("prepare", "sensitivity"): "assembling for derivatives",
    ("error", COARSER): "estimating errors: the history on a coarser mesh",
    ("error", TIME): "estimating the error of the time steps: half of the steps",
    ("error", BETTER): "estimating the error of the mesh: a better one",
    ("error", PAIRS): "estimating the error of the pairs: with sliding",
    ("output", "sensitivity"): "finding derivatives",
    ("output", "pictures"): "drawing",
}


class Speaker:
    """Context with a bar on a terminal, plain lines elsewhere; silent if quiet."""

    def __init__(self, quiet: bool, *columns: ProgressColumn) -> None:
        """
        Args:
            columns: of the bar, behind what is done.
        """
        self.quiet, self.console = quiet, Terminal(stderr=True, highlight=False, markup=False)
        shown = (TextColumn("{task.description}"), BarColumn(), *columns)
        self.progress = Progress(*shown, console=self.console, disable=quiet or not self.console.is_terminal)

    def __enter__(self) -> Self:
        self.progress.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.progress.stop()

    def line(self, *lines: str) -> None:
        """Print lines that stay, unless it is to be quiet."""
        for text in () if self.quiet else lines:
            self.console.print(text, soft_wrap=True)


class Reporter(Speaker):
    """Speaks of a run on rank 0."""

    def __init__(self, quiet: bool, verbose: bool) -> None:
        super().__init__(quiet, MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
        self.verbose, self.task = verbose, self.progress.add_task("meshing and preparing", total=None)
        self.began, self.done, self.count = monotonic(), 0, 0  # of solving; steps of this round; of them all
        self.told = np.inf  # when the last line on estimates was said
        self.since = self.spoke = monotonic()  # when what is done now began, and was last spoken of
        self.clock: Clock | None = None  # of the run, once something began
        self.phase = ""  # that was last spoken of
        self.over = Event()

    def __enter__(self) -> Self:
        if not self.console.is_terminal:
            self.line("meshing and preparing ...")
            Thread(target=self._keep_speaking, daemon=True).start()
        return super().__enter__()

    def __exit__(self, *error: object) -> None:
        self.over.set()
        super().__exit__(*error)

    def line(self, *lines: str) -> None:
        self.spoke = monotonic()
        super().line(*lines)

    def _keep_speaking(self) -> None:
        """Say after `ANNOUNCED` seconds of silence what is done, then each time when it has lasted twice as long."""
        while not self.over.wait(ANNOUNCED / 5):
            now = monotonic()
            if now - max(self.spoke, self.since) >= max(ANNOUNCED, self.spoke - self.since):
                left = self.clock.left if self.clock else None
                still = "" if left is None else time_left(left) or f", about {left:.0f} s left"
                self.line(f"{self.progress.tasks[0].description}: {now - self.since:.0f} s so far{still}")

    def watch(self) -> Watch:
        """Callbacks for the run."""
        return Watch(
            on_mesh=self._meshed,
            on_prepared=self._prepared,
            on_iteration=self._iteration,
            on_step=self._step,
            on_estimate=self._estimate,
            on_resume=self._resumed,
            on_note=self._note,
            on_phase=self._phase,
            answer="" if self.quiet else "stickslip: stopping; what does not stop in five seconds is ended",
            on_round=self.line,
        )

    def _meshed(self, report: MeshReport) -> None:
        self.line(*report.lines(), *(f"warning: {line}" for line in report.warnings()))

    def _prepared(self, simulation: Simulation) -> None:
        times = simulation.scene.requested_times()
        self.began, self.done, self.count, self.told = monotonic(), 0, len(times), np.inf
        self.progress.update(self.task, total=len(times), completed=0, description="solving")
        free, points = simulation.system.constraints.free_total, simulation.stepper.cone.size
        self.line(f"{free} unknown displacements, {points} contact unknowns, {len(times)} steps")
        self.line(*(f"warning: {warning}" for warning in warnings(simulation.scene)))

    def _iteration(self, row: HistoryRow) -> None:
        if self.verbose:
            self.line(f"  t = {row.time:g}  iteration {row.step.iteration}  residual {row.step.residual:.1e}")
        text = f"solving t = {row.time:g}, iteration {row.step.iteration}, residual {row.step.residual:.0e}"
        self.progress.update(self.task, description=text)

    def _step(self, step: StepResult) -> None:
        self.progress.advance(self.task)
        self.done += 1
        if not self.console.is_terminal or self.verbose:
            took = (monotonic() - self.began) / self.done
            left = time_left(took * (self.count - self.done))
            self.line(f"t = {step.time:g}: {step.iterations} iterations, residual {step.residual:.1e}{left}")

    def _estimate(self, line: str) -> None:
        self.progress.update(self.task, description=line)
        self.told = min(self.told, now := monotonic())
        if not self.console.is_terminal and now - self.told > ANNOUNCED:
            self.told = now
            self.line(line)

    def _phase(self, clock: Clock, phase: str, part: str) -> None:
        """Say what begins: on a terminal always, else if it will take longer than others take to answer."""
        self.clock, said = clock, PARTS_SAID.get((phase, part))
        if (said is None and phase == self.phase) or (phase == "prepare" and not clock.expected):
            return
        self.since, self.phase, text = monotonic(), phase, said or SAID.get(phase, phase)
        audit = clock.seconds("assemble") * (1 + self.done / 4)
        of_error = clock.expected if said and phase == "error" else 0.0
        about = {("prepare", ""): clock.expected, ("audit", ""): audit}.get((phase, part), of_error)
        long = about >= ANNOUNCED
        text += f", about {about:.0f} s" if long else ""
        self.progress.update(self.task, description=text)
        if long and not self.console.is_terminal:
            self.line(f"{text} ...")

    def _resumed(self, done: int, time: float) -> None:
        self.progress.advance(self.task, done)
        self.count -= done
        self.line(f"resumed after step {done}, t = {time:g}")

    def _note(self, line: str) -> None:
        self.console.print(f"stickslip: {line}", soft_wrap=True)  # also where it is to be quiet

    def table(self, content: Content) -> None:
        """Contacts by step, then cost and accuracy."""
        if self.quiet:
            return
        out = console(160)
        out.print(content["scene"]["title"])
        if content["steps"]:
            print_table(_contacts(content), out)
            out.print(legend(content), soft_wrap=True)
        else:
            out.print("no step was solved")
        head, rows = error_budget(content)
        if rows:
            print_table(table_of(head, rows, ("number", NEGLECTED)), out)
        for line in neglect_lines(content) if self.verbose else ():
            out.print(line, soft_wrap=True)
        seconds, counters, audit = content["seconds"], content["counters"], content["audit"]
        names = ("imports", "mesh", "assemble", "prepare", "iterate", "error", "audit", "output", "other")
        phases = ", ".join(f"{name} {seconds[name]:.2f}" for name in names)
        out.print(f"method {content['method']}, {counters['volume_solves']} volume solves, {content['dofs']} unknowns")
        out.print(f"seconds: {phases}, total {seconds['total']:.2f}")
        if np.isfinite(error := content["error"]["discretisation"] or np.nan):
            out.print(f"the mesh leaves an error of about {error:.1%} (displacement, energy norm)")
        defects = ", ".join(
            f"{name.replace('_', ' ')} {value:.0e}" for name, value in audit.items() if value is not None
        )
        if defects:
            out.print(f"audit (relative defects): {defects}")
        elif not content["scene"]["output"]["audit"]:
            out.print("audit: left out, output.audit = false")
        if content["steps"] and content["steps"][-1]["energy"]["dissipated"] > 0:
            energy, units = content["steps"][-1]["energy"], Units.of(content["scene"].get("units", "SI"))
            unit = units("J/m" if content["scene"]["model"].startswith("plane") else "J")
            dissipated = with_error(energy["dissipated"], error_of(energy, "dissipated"), unit)
            wears = any("max_wear" in contact for contact in content["steps"][-1]["contacts"].values())
            left = with_error(energy["time_remainder"], None, unit)
            out.print(f"friction{' and wear' * wears} dissipated {dissipated}, time remainder {left}")

    def files(self, outcome: Outcome) -> None:
        """Print what to doubt, and which files to open."""
        self.line(*(f"warning: {warning}" for warning in outcome.warnings))
        if self.quiet:
            return
        folder, by_reader = outcome.folder, {"ParaView": list[str](), "scripts": ["result.json"]}
        for kind in registered():
            there = (pattern for pattern in kind.files if any(folder.glob(pattern)))
            by_reader.setdefault(kind.reader, []).extend(there)
        pictures = sorted(path.name for pattern in by_reader.pop("viewers", ()) for path in folder.glob(pattern))
        said = (
            f"{listed(dict.fromkeys(files))} for {reader}" for reader, files in by_reader.items() if reader and files
        )
        print(f"results in {printable(str(folder))}: {', '.join(said)},")
        print(f"pictures {', '.join(pictures)}" if pictures else "no pictures")


def time_left(seconds: float) -> str:
    """Say how long the steps to come will take; nothing below a minute.

    >>> time_left(59.0), time_left(100.0), time_left(20_000.0)
    ('', ', about 2 minutes left', ', about 5.6 hours left')
    """
    if seconds < 60:
        return ""
    minutes = seconds / 60
    return f", about {minutes:.0f} minutes left" if minutes < 120 else f", about {minutes / 60:.1f} hours left"


class Terminal(Console):
    """A console on which a text of the user's is no command."""

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(printable(text), **options)


def console(width: int, quiet: bool = False) -> Console:
    """Standard output, `width` columns wide unless it is a terminal; [m²] is a unit, and no markup."""
    return Terminal(highlight=False, markup=False, width=None if sys.stdout.isatty() else width, quiet=quiet)


def table_of(heads: Iterable[str], rows: Iterable[Iterable[str]], words: Container[str]) -> Table:
    """A table; columns with heads of `words` hold words, all others numbers."""
    table = Table()
    for head in heads:
        table.add_column(head, justify="left" if head in words else "right")
    for row in rows:
        table.add_row(*row)
    return table


def print_table(table: Table, out: Console) -> None:
    """Print the table; a narrow terminal folds its heads and leaves out its last columns, for a cut number misleads."""
    free = out.options.update(max_width=10_000)

    def too_wide() -> bool:
        return out.measure(table, options=free).maximum > out.width

    if too_wide():
        for column in table.columns:
            column.header = str(column.header).replace(" ", "\n")
    while len(table.columns) > 1 and too_wide():
        table.columns.pop()
    out.print(table)


def _contacts(content: Content) -> Table:
    numbers, rows = contact_numbers(content["scene"]["model"], Units.of(content["scene"].get("units", "SI"))), []
    for step in content["steps"]:
        cost = (str(step["iterations"]), str(step["volume_solves"]))
        moved = max((body["max_displacement"] for body in (step.get("bodies") or {}).values()), default=0.0)
        for name, contact in (step["contacts"] or {"-": None}).items():
            rows.append((f"{step['time']:g}", name, *contact_cells(contact, numbers, moved), *cost))
    return table_of(("t", "contact", *numbers.values(), "iterations", "volume solves"), rows, ("contact",))


def contact_numbers(model: str, units: Units) -> dict[str, str]:
    """Heads of the numbers of a contact, by their keys; in plane models for a metre of thickness."""
    force, area = ("N/m", "m") if model.startswith("plane") else ("N", "m²")
    heads = {
        "normal_force": f"normal force [{force}]",
        "tangential_force": f"tangential [{force}]",
        "contact_area": f"touching [{area}]",
        "stick_area": "stick",
        "slip_area": "slip",
        "max_pressure": "max pressure [Pa]",
        "max_penetration": "max penetration [m]",
    }
    return {key: units.label(head) for key, head in heads.items()}


def contact_cells(contact: Content | None, keys: Iterable[str], moved: float = 0.0) -> list[str]:
    """Numbers of a contact of result.json, with their errors; a penetration of rounding is 0.

    Args:
        moved: largest displacement of the bodies [m].
    """
    return ["-" if contact is None else _cell(contact, key, moved) for key in keys]


def _cell(contact: Content, key: str, moved: float) -> str:
    value, parts = contact[key], error_of(contact, key)
    # of the displacement: so small a penetration is that of the solution's digits
    if key == "max_penetration" and value + (stated(parts) or 0.0) <= EXACT * moved:
        return "0"
    return of_parts(value, parts)


def print_plan(content: Content) -> None:
    """Effects, reasons, and counts where the scene was meshed."""
    out = console(120)
    out.print(content["title"])
    heads = ("effect", "on", "because", "adds")
    effects = ((row["effect"], "yes" if row["on"] else "-", row["because"], row["adds"]) for row in content["effects"])
    out.print(table_of(heads, effects, heads))
    times = content["times"]
    shown = ", ".join(f"{t:g}" for t in times[:8]) + (", ..." if len(times) > 8 else "")
    units = "" if content["units"] == "SI" else f", units {content['units']}"
    out.print(f"model {content['model']}{units}, method {content['method']}, {len(times)} steps at t = {shown}")
    for warning in content["warnings"]:
        out.print(f"warning: {warning}")
    if "mesh" in content:
        mesh = content["mesh"]
        choice = mesh["choice"]
        out.print(f"{mesh['displacement_unknowns']} unknown displacements")
        out.print(f"{choice['method']}, {choice['surface']}: {choice['because']}")
        for name, c in mesh["contacts"].items():
            if c["dropped_multipliers"]:
                out.print(f"contact {name}: {c['dropped_multipliers']} multipliers dropped")
        contacts = {name: ContactReport(**c) for name, c in mesh["contacts"].items()}
        keys = ("cells", "nodes", "worst_quality", "plane", "units", "seams", "note")
        report = MeshReport(**{key: mesh[key] for key in keys}, contacts=contacts)
        print_mesh(report, out)
        print_memory(content["memory"], out)
    elif content["memory"]:
        peak = content["memory"]["peak"]
        out.print(f"about {peak / 1e9:.2g} GB of memory, by the expected number of cells")


def print_memory(memory: Content, out: Console) -> None:
    """The memory that a run will take, by part, beside what is free; memory: see `Demand.plain`."""
    heads, rows = ("memory of", "bytes an unknown", "rank 0 [GB]", "machine [GB]", "while"), []
    for part in memory["parts"]:
        sizes = (f"{part[key] / 1e9:.3f}" for key in ("rank", "machine"))
        rows.append((part["part"], f"{part['per_unknown']:.0f}", *sizes, ", ".join(part["stages"])))
    print_table(table_of(heads, rows, ("memory of", "while")), out)
    stage, free = max(memory["stages"], key=memory["stages"].get), memory["free"]
    known = "no limit is known" if free >= 2.0**62 else f"{free / 1e9:.3g} GB are free"
    peak = f"{memory['peak'] / 1e9:.2g} GB of rank 0, {memory['machine'] / 1e9:.2g} GB of the machine"
    out.print(f"peak while {stage}: {peak}; {known}")


def print_mesh(report: MeshReport, out: Console) -> None:
    """The mesh in a table, its contacts in another, warnings below."""
    out.print(f"{report.cells} cells, {report.nodes} nodes, worst quality {report.worst_quality:.2f} (1 is best)")
    out.print(report.note, end="\n" if report.note else "")
    rows, (area, unit), length = list[tuple[str, ...]](), report.area_unit, report.length_unit
    heads = ["contact", "normal points", "tangential", f"{area} [{unit}]", "elements across", "other side"]
    heads += [f"smallest gap [{length}]", f"largest gap [{length}]", "overlapping points", f"overlap [{unit}]"]
    for name, c in report.contacts.items():
        gaps = (f"{c.smallest_gap:.4g}", f"{c.largest_gap:.4g}", str(c.overlapping_points), f"{c.overlap_area:.4g}")
        other = "" if c.other_elements_across is None else f"{c.other_elements_across} (× {c.other_size:.3g})"
        points = (str(c.normal_points), str(c.tangential_points), f"{c.area:.4g}", str(c.elements_across), other)
        rows.append((name, *points, *gaps, str(c.points_that_can_touch)))
    if rows:
        print_table(table_of([*heads, "can touch"], rows, ("contact",)), out)
    for line in report.warnings():
        out.print(f"warning: {line}", soft_wrap=True)
