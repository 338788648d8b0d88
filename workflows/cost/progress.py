"""Progress of `stickslip cost` while it climbs, and its tables at the end."""

from __future__ import annotations

from collections.abc import Sequence

from rich.progress import TextColumn

from stickslip.workflows.cost.foresee import ASKED, Price, Row
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.study import Study
from stickslip.workflows.cost.tables import Line, duration, explained, percent, seconds
from stickslip.workflows.run.terminal import Speaker, console, print_table, table_of

PRICES = ("1 % [s]", ".1 % [s]", ".01 % [s]")


class Teller(Speaker):
    """Speaks of a study: its bar is the budget."""

    def __init__(self, budget: float, quiet: bool) -> None:
        super().__init__(quiet, TextColumn("{task.fields[left]} left"))
        self.budget = budget
        self.task = self.progress.add_task("starting", total=budget, left=seconds(budget))

    def next(self, what: str, spent: float, runs: int) -> None:
        """Show what is being solved and how much of the budget is used."""
        left = seconds(max(0.0, self.budget - spent))
        self.progress.update(self.task, description=f"run {runs + 1}: {what}", completed=spent, left=left)

    def done(self, run: Run) -> None:
        """Report a run that has ended, with or without an answer."""
        rung = run.rung
        what = f"order {rung.order}, {rung.method}, h = {run.h:.3g}, tolerance {rung.tolerance:.0e}"
        took = f"{seconds(run.seconds)}, {seconds(run.spent)} with the start of its process"
        how = f"{run.dofs} unknowns, {took}" if run.converged else f"{run.status}: {run.sentence}"
        if not run.converged or not self.console.is_terminal:
            self.line(f"{what}: {' '.join(how.split())}")

    def table(self, studies: Sequence[Study]) -> None:
        """One row for each quantity."""
        if self.quiet or not studies:
            return
        rows, words = [], ("quantity", "because", "orders")
        for study in studies:
            truth, best = study.truth, study.most_exact
            costs = [study.cheapest(level) for level in (1e-2, 1e-3, 1e-4)]
            shown = [f"{run.waited:.2g}" if run else "-" for run in costs]
            sure = percent(truth.uncertainty) if truth.converges else "-"
            because = truth.source if truth.converges else "one mesh only" if truth.meshes < 2 else "does not settle"
            exact = percent(study.sure[best.rung]) if best else "-"
            about = (truth.name, f"{truth.value:.6g}", sure, because, _of_steps(study), _orders(study))
            rows.append((*about, *shown, exact))
        heads = ("quantity", "value", "sure to", "because", "time steps", "orders", *PRICES, "best")
        print_table(table_of(heads, rows, words), console(160))
        self.line(*filter(None, map(explained, studies)))

    def methods(self, found: Sequence[Line], methods: Sequence[str]) -> None:
        """Seconds and volume solves of methods that are laid side by side: one row for each mesh and method."""
        if self.quiet or not found:
            return
        table = table_of(("order", "h", "method", "seconds", "volume solves"), (), ("method",))
        for line in found:
            for k, (method, run) in enumerate(zip(methods, line.runs, strict=True)):
                mesh = ("", "") if k else (str(line.order), f"{line.h:.3g}")
                table.add_row(*mesh, method, *_work(run), end_section=k + 1 == len(methods))
        print_table(table, console(160))


def print_prices(rows: Sequence[Row]) -> None:
    """About how long accuracies of numbers will take."""
    out, heads = console(120), ("number", "about", "±, coarse", *(f"{100 * asked:g} %" for asked in ASKED))
    cells = (
        (row.name, f"{row.value:.4g}", "-" if row.why_not else percent(row.error), *map(_price, row.prices))
        for row in rows
    )
    print_table(table_of(heads, cells, ("number",)), out)
    for row in rows:
        if row.why_not:
            out.print(f"{row.name}: {row.why_not}", soft_wrap=True)
    told = "On this machine, order 1, all cells refined alike and steps split, by the trend of coarse versions."
    out.print(f"{told} run --accuracy refines where errors are large.", soft_wrap=True)
    columns = "about: the number of the finest coarse version; ±, coarse: its error there; "
    columns += f"{', '.join(f'{100 * asked:g} %' for asked in ASKED)}: the time to an error so small "
    columns += "(-: out of reach), of the processor and without pictures, and between what it may lie"
    out.print(columns, soft_wrap=True)


def _price(found: Price | None) -> str:
    """Of an accuracy, and between what it is likely to lie; an extrapolation over days tells no number."""
    if found is None:
        return "-"
    if found.seconds >= 86400.0:
        return "more than a day"
    low, high = (duration(each) for each in found.between)
    return f"{duration(found.seconds)} ({low} to {high})"


def _work(run: Run | None) -> tuple[str, str]:
    """Seconds and volume solves."""
    if run is None:
        return "-", "-"
    return (f"{run.seconds:.2g}", str(run.volume_solves)) if run.converged else (run.status.replace("_", " "), "-")


def _of_steps(study: Study) -> str:
    """Error that the time steps leave, where it was measured."""
    if study.truth.exact or study.time_step is None:
        return "-"
    return percent(study.time_step) if study.time_step else "0 %"


def _orders(study: Study) -> str:
    """Observed powers of h by order; of all methods the lowest, as they lie close together."""
    orders = sorted({order for order, _ in study.rates})
    lowest = {order: min(rate for (o, _), rate in study.rates.items() if o == order) for order in orders}
    return ", ".join(f"P{order}: {rate:.1f}" for order, rate in lowest.items())
