"""What accuracy costs, in one sentence."""

from __future__ import annotations

from collections.abc import Sequence

from stickslip.geometry.arrays import CLOSE
from stickslip.workflows.cost.run_record import Run
from stickslip.workflows.cost.study import Study

FIRST = 1e-2  # first relative error; each next digit divides it by ten


def headline(studies: Sequence[Study]) -> str:
    """The sentence of the first quantity that has a limit."""
    if not studies:
        return "No run came to an end, or no quantity differs from zero."
    return sentence(next((study for study in studies if study.truth.converges), studies[0]))


def sentence(study: Study) -> str:
    """`1 % of base.max_pressure costs 3.1 s with ...; the next digit costs 21 s.`"""
    unknown = "" if study.time_step is not None else "; the error of the time steps is not known"
    name = study.truth.name
    if study.truth.meshes < 2:
        return f"{name}: one mesh only, there is nothing to measure its error by; give it a larger --budget."
    if not study.truth.converges:
        return f"{name} does not settle on these meshes, too coarse yet or close to a singular corner: it has no price."
    run, best = study.cheapest(FIRST), study.most_exact
    if best is None:
        return f"{name}: no run came to an end."
    if run is None:
        return f"1 % of {name} was not reached: {_least(study, best)}{unknown}."
    said = f"1 % of {name} costs {seconds(run.seconds)} with {choice(run, study)}"
    following = study.cheapest(FIRST / 10)
    if following is run:
        return f"{said}, and the next digit comes with it{unknown}."
    if following is not None:
        return f"{said}; the next digit costs {seconds(following.seconds)}{_changes(run, following)}{unknown}."
    return f"{said}; the next digit was not reached: {_least(study, best)}{unknown}."


def choice(run: Run, study: Study) -> str:
    """Order, mesh size, method, and the tolerance where it is not the scene's."""
    loose = "" if run.rung.tolerance == study.tolerance else f", tolerance {run.rung.tolerance:.0e}"
    return f"order {run.rung.order}, h = {run.h:.3g}, {run.rung.method}{loose}"


def seconds(value: float) -> str:
    """Two digits.

    >>> seconds(0.123), seconds(3.14), seconds(123.4)
    ('0.12 s', '3.1 s', '123 s')
    """
    return f"{value:.0f} s" if value >= 10 else f"{value:.1f} s" if value >= 1 else f"{value:.2g} s"


def duration(value: float) -> str:
    """A time that may be long [s], two digits, in a unit that fits it.

    >>> duration(0.5), duration(900.0), duration(86400.0 * 45), duration(1e12)
    ('0.5 s', '15 min', '45 days', '32000 years')
    """
    for unit, size, most in (("min", 60.0, 120.0), ("h", 3600.0, 48.0), ("days", 86400.0, 730.0)):
        if value < 600.0:
            return seconds(value)
        if value / size < most:
            return f"{float(f'{value / size:.2g}'):.0f} {unit}"
    return f"{float(f'{value / 31557600.0:.2g}'):.0f} years"


def percent(value: float) -> str:
    """A share in per cent, two digits.

    >>> percent(1.234), percent(0.0123), percent(2e-6)
    ('123 %', '1.2 %', '0.0002 %')
    """
    if value >= 0.1:
        return f"{100 * value:.0f} %"
    return f"{100 * value:.2g} %" if value >= CLOSE else f"{100 * value:.0e} %"


def _changes(run: Run, following: Run) -> str:
    """What the next digit takes besides a finer mesh."""
    new = [] if following.rung.order == run.rung.order else [f"order {following.rung.order}"]
    new += [f"h = {following.h:.3g}"] if following.h != run.h else []
    new += [following.rung.method] if following.rung.method != run.rung.method else []
    new += [] if following.rung.tolerance == run.rung.tolerance else [f"tolerance {following.rung.tolerance:.0e}"]
    return f" with {', '.join(new)}"


def _least(study: Study, best: Run) -> str:
    """The smallest error, and what limits it."""
    of_steps = study.time_step or 0.0
    if of_steps > study.truth.uncertainty and of_steps > study.worst[best.rung]:
        return f"the time steps alone leave {percent(of_steps)}, it takes more of them (steps.count)"
    if study.worst[best.rung] <= study.truth.uncertainty:
        return f"the reference itself is sure to {percent(study.truth.uncertainty)} only"
    return f"the best is {percent(study.sure[best.rung])} for {seconds(best.seconds)} with {choice(best, study)}"
