"""Bodies that share nodes, of two materials, against springs in series and side by side."""

from stickslip.workflows.lab.verification.cases import two_materials as case
from stickslip.workflows.lab.verification.check import failures


def test_two_materials_are_springs_in_series_and_side_by_side() -> None:
    assert not failures(case.checks("condensed-newton"))
