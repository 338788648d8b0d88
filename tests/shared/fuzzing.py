"""How much is drawn by lot, and what every refusal looks like."""

from __future__ import annotations

import os

EXAMPLES = int(os.environ.get("FUZZ", "5"))  # `make fuzz N=20000`


def assert_refusal(said: str, code: int = 2) -> None:
    """One line of less than 300 characters."""
    lines = said.splitlines()
    assert lines, code
    assert "Traceback" not in said, said
    assert len(lines) <= 3, said  # notes of the run, which stand above the refusal
    assert all(line.startswith("stickslip: ") for line in lines), said
    assert len(lines[-1]) < 300, said
