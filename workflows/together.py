"""Rank 0 acts, and all ranks fail or none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry.errors import MachineError, StickslipError


def raise_together(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on rank 0; its error, if any, is raised on every rank."""
    failure: StickslipError | None = None
    mistake: Exception | None = None
    if comm.rank == 0:
        try:
            act()
        except StickslipError as error:
            failure = error
        except OSError as error:
            failure = MachineError(f"{error.filename or 'results'}: {error.strerror or error}")
        except Exception as error:  # a mistake of ours: rank 0 shows it, the others must not wait for ever
            failure, mistake = StickslipError(f"rank 0 failed: {error}"), error
    failure = comm.bcast(failure)
    if mistake is not None:
        raise mistake
    if failure is not None:
        raise failure
