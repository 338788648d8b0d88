"""The verdict on a run: each number of the audit has a limit, and a run that passes one is doubtful."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict

from stickslip.geometry.arrays import CLOSE, ROUNDING, SLIGHT
from stickslip.solvers.results.audit import Audit

ITERATE, UNITS = "try a smaller solver.tolerance or another solver.method", "check the units of E, loads and lengths"
DEFECT = "no setting of the scene decides that: it is a defect of the program or of the files; please report it"
HINTS: Mapping[str, str] = {  # what to do about each number of the audit
    "equilibrium": f"{ITERATE}, and {UNITS}",
    "moment": DEFECT,
    "rounding": f"the last digit of the displacements decides the forces; {UNITS}, or keep bodies from moving far",
    "supports": DEFECT,
    "penetration": ITERATE,
    "negative_pressure": ITERATE,
    "cone": ITERATE,
    "complementarity": ITERATE,
    "dissipation": ITERATE,
    "fields": DEFECT,
    "numbers": DEFECT,
    "files": DEFECT,
}


def limits(tolerance: float, law_error: float = 0.0, rounding: float = 0.0) -> Audit:
    """Largest defects of a sound step.

    Args:
        tolerance: solver.tolerance.
        law_error: that the method states of its approximate contact laws, see `StepResult.law_error`.
        rounding: `Audit.rounding` of the step.
    """
    iterated = 30 * tolerance  # the scales of the audit are the step's own, smaller than those of the tolerance
    # ready scenes stay below 1e-7; the error that a method states of its laws is of the whole body, this of one point
    laws = max(1e-5, iterated, min(30 * law_error, 0.1))
    return Audit(
        # out of balance; the ready scenes stay below 2e-9
        # rounding of the displacement, beyond which stresses and forces are noise: the solver's own comes on top
        equilibrium=max(CLOSE, iterated, 10 * min(rounding, SLIGHT)),
        moment=SLIGHT,  # facets beside curved sides
        rounding=SLIGHT,
        # what no iteration decides: supports, and fields that follow from displacement and tractions
        supports=ROUNDING,
        penetration=laws,
        negative_pressure=laws,
        cone=laws,
        complementarity=laws,
        dissipation=laws,
        fields=ROUNDING,
        numbers=SLIGHT,  # many are sums of what cancels
        files=ROUNDING,
    )


def passed(
    audits: Sequence[Audit | None], times: Sequence[float], law_errors: Sequence[float], tolerance: float
) -> Iterator[str]:
    """Sentences on the defects that pass their limits: for each its worst step, and what to do about it.

    Args:
        audits: one a step; None: it is not judged.
        times: of the steps [s].
        law_errors: of the steps [-].
        tolerance: solver.tolerance.
    """
    steps = zip(audits, times, law_errors, strict=True)
    judged = [
        (f"step {k} (t = {time:g})", asdict(audit), asdict(limits(tolerance, error, audit.rounding)))
        for k, (audit, time, error) in enumerate(steps, 1)
        if audit is not None
    ]
    for name in judged[0][1] if judged else ():
        ratios = [found[name] / limit[name] for _, found, limit in judged]
        over = [ratio if ratio == ratio else float("inf") for ratio in ratios]  # NaN passes every limit
        step, found, limit = judged[max(range(len(over)), key=over.__getitem__)]
        if max(over) > 1:
            yield (
                f"{name.replace('_', ' ')} is {found[name]:.1e} in {step}, more than {limit[name]:.1e}: {HINTS[name]}"
            )
