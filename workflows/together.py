"""Rank 0 acts, and all ranks fail or none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from geometry.errors import MachineError, StickslipError

T = TypeVar("T")


def raise_together(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on rank 0; its error, if any, is raised on every rank."""
    failure: StickslipError | None = None
    mistake: BaseException | None = None
    if comm.rank == 0:
        try:
            act()
        except StickslipError as error:
            failure = error
        except OSError as error:
            failure = MachineError(f"{error.filename or 'results'}: {error.strerror or error}")
        except (Exception, SystemExit) as error:  # rank 0 shows it, the others must not wait for ever
            failure, mistake = StickslipError(f"rank 0 failed: {error}"), error
    failure = comm.bcast(failure)
    if mistake is not None:
        raise mistake
    if failure is not None:
        raise failure


def told_by_rank_0(comm: Any, act: Callable[[], T]) -> T:
    """What `act` returns on rank 0, on every rank; its error, if any, is raised on every rank."""
    found: list[T] = []
    raise_together(comm, lambda: found.append(act()))
    told: T = comm.bcast(found[0] if found else None)
    return told
