"""Rank 0 acts, or each rank does its part, and all ranks fail or none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from stickslip.geometry.errors import MachineError, StickslipError

T = TypeVar("T")


def raise_together(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on rank 0; its error, if any, is raised on every rank."""
    failure, mistake = _failed(act, 0) if comm.rank == 0 else (None, None)
    _raise(comm.bcast(failure), mistake)


def all_act(comm: Any, act: Callable[[], object]) -> None:
    """Run `act` on every rank; the first error, if any, is raised on every rank."""
    failure, mistake = _failed(act, comm.rank)
    _raise(next((f for f in comm.allgather(failure) if f is not None), None), mistake)


def _failed(act: Callable[[], object], rank: int) -> tuple[StickslipError | None, BaseException | None]:
    """What to tell the others, and what to show here."""
    try:
        act()
    except StickslipError as error:
        return error, None
    except OSError as error:
        return MachineError(f"{error.filename or 'results'}: {error.strerror or error}"), None
    except (Exception, SystemExit) as error:  # this rank shows it, the others must not wait for ever
        return StickslipError(f"rank {rank} failed: {error}"), error
    return None, None


def _raise(failure: StickslipError | None, mistake: BaseException | None) -> None:
    if mistake is not None:
        raise mistake
    if failure is not None:
        raise failure


def from_rank_0(comm: Any, act: Callable[[], T]) -> T:
    """What `act` returns on rank 0, on every rank; its error, if any, is raised on every rank."""
    found: list[T] = []
    raise_together(comm, lambda: found.append(act()))
    shared: T = comm.bcast(found[0] if found else None)
    return shared
