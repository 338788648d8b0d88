"""What a verification problem misses, in sentences."""

from collections.abc import Iterable

from stickslip.workflows.lab.verification.check import Check


def failures(checks: Iterable[Check]) -> list[str]:
    """A sentence for each check that does not pass; raises if there is nothing to check."""
    all_checks = list(checks)
    if not all_checks:
        raise ValueError("nothing was checked")
    return [str(check) for check in all_checks if not check.passed]
