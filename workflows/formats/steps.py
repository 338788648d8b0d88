"""One reported step is one file, steps/000012.h5: fields to look at, and the checkpoint to go on from.

Beside the fields by name stands the group `checkpoint`: the whole `StepResult`, and what the run needs to go on. A step
whose fields are not asked for is a light file, steps/000012.light.h5: its `StepResult` without fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stickslip.geometry.arrays import AnyArray, Array
from stickslip.geometry.errors import MachineError
from stickslip.solvers.parallel.serialise import Plain
from stickslip.solvers.results.step_result import ContactState, StepResult, from_plain, to_plain
from stickslip.workflows.formats.files import make_folder
from stickslip.workflows.formats.hdf5 import read_arrays, write_arrays
from stickslip.workflows.formats.serialised import BYTES, TEXT, from_arrays, to_arrays

CHECKPOINT = "checkpoint"  # a group
NUMBERS = ("time", "p_ref", "u_ref")
STATE = ("p", "w", "reference", "driven", "shortened")  # arrays of the group "state"
GROUPS = ("searched", "memory")  # arrays by contact


@dataclass(frozen=True, kw_only=True)
class StoredContact:
    """A contact surface of n nodes as stored; vectors have three components, the third is 0 in a plane model."""

    weight: Array  # (n,) [m^(d-1)]
    gap: Array  # (n,) [m], negative: penetration
    pressure: Array  # (n,) [Pa]
    traction: Array  # (n, 3) sigma_T [Pa]
    slip: Array  # (n, 3) since t = 0 [m]
    slip_increment: Array  # (n, 3) since the last accepted step [m]
    lam: Array  # (n, 3) [-]
    status: NDArray[np.int8]  # (n,) OPEN, SLIP or STICK
    wear: Array | None = None  # (n,) worn depth [m]; None: nothing wears
    rate: Array | None = None  # (n,) slip rate [m/s]; None: friction does not know it


@dataclass(frozen=True, kw_only=True)
class StoredStep:
    """A step as stored."""

    index: int
    time: float
    p_ref: float  # [Pa]
    u_ref: float  # [m]
    displacement: Array  # (nodes, 3) [m]
    stress: Array  # (cells, 3, 3) [Pa]
    von_mises: Array  # (cells,) [Pa]
    stress_error: Array  # (cells,) [Pa]; empty: not estimated
    contacts: Mapping[str, StoredContact]
    p: Array  # (rows,) flat tractions [Pa]
    w: Array  # (rows,) flat relative displacement [m]
    reference: Array  # (rows,) what the laws count w from [m]
    driven: Array  # (o,) motion of the obstacles that forces drive [m]
    shortened: Array  # (b,) that are found: shortening of bolts by force, slack of springs of one way [m]
    searched: Mapping[str, Array]  # where sliding contacts were paired [m]
    memory: Mapping[str, Array]  # what friction remembers of the slip of points


def step_name(index: int) -> str:
    """Path below the results folder.

    >>> step_name(12)
    'steps/000012.h5'
    """
    return f"steps/{index:06d}.h5"


def light_name(index: int) -> str:
    """Path of a light file below the results folder.

    >>> light_name(12)
    'steps/000012.light.h5'
    """
    return f"steps/{index:06d}.light.h5"


def shown_as(field: str) -> str:
    """Name of a field of `StoredContact` in all files that people open; lambda is a word of Python's.

    >>> shown_as("lam"), shown_as("gap")
    ('lambda', 'gap')
    """
    return {"lam": "lambda"}.get(field, field)


def step_files(folder: Path) -> dict[int, Path]:
    """Return the files of steps with fields below the results folder by index; what else a user keeps there is none."""
    return {int(path.stem): path for path in sorted(folder.glob(f"steps/{'[0-9]' * 6}.h5"))}


def light_files(folder: Path) -> dict[int, Path]:
    """Return the files of steps without fields."""
    return {int(path.name[:6]): path for path in sorted(folder.glob(f"steps/{'[0-9]' * 6}.light.h5"))}


def three(values: Array) -> Array:
    """Pad vectors (n, d) to (n, 3).

    >>> three(np.array([[1.0, 2.0]]))
    array([[1., 2., 0.]])
    """
    return np.pad(values, ((0, 0), (0, 3 - values.shape[1])))


def write_step(folder: Path, index: int, result: StepResult, going: Plain = None) -> Path:
    """Write the step's file below `folder` and return its path.

    Args:
        going: what the run needs to go on from here.

    Raises:
        MachineError: the disk is full; no half file is left.
    """
    arrays: dict[str, AnyArray] = {
        "displacement": three(result.displacement),
        "stress": result.stress.reshape(-1, 9),
        "von_mises": result.von_mises,
        "stress_error": result.stress_error,
        **{f"state/{name}": getattr(result, name) for name in STATE},
        **{f"{group}/{name}": array for group in GROUPS for name, array in getattr(result, group).items()},
    }
    for name, contact in result.contacts.items():
        arrays |= {f"contacts/{name}/{key}": value for key, value in _columns(contact).items()}
    return _write(folder / step_name(index), index, result, going, arrays, NUMBERS)


def write_light(folder: Path, index: int, result: StepResult, going: Plain = None) -> Path:
    """Write a step without its fields, and return the path of the file; see `write_step`."""
    return _write(folder / light_name(index), index, result.without_fields(), going, {}, ("time",))


def _write(
    path: Path, index: int, result: StepResult, going: Plain, arrays: dict[str, AnyArray], numbers: Iterable[str]
) -> Path:
    plain = {"result": to_plain(result), "going": going}
    checkpoint = {f"{CHECKPOINT}/{name}": array for name, array in to_arrays(plain, arrays).items()}
    make_folder(path.parent)
    told = {"index": int(index), **{name: float(getattr(result, name)) for name in numbers}}
    write_arrays(path, arrays | checkpoint, told)
    return path


def read_step(path: Path) -> StoredStep:
    """Read a step's file back, verified.

    Raises:
        DamagedError: cut short, or damaged.
        MachineError: it cannot be read, or is not a step.
    """
    arrays, numbers = _arrays(path, f"{CHECKPOINT}/")
    contacts: dict[str, dict[str, AnyArray]] = {}
    for name, array in arrays.items():
        if name.startswith("contacts/"):
            _, contact, column = name.split("/")
            contacts.setdefault(contact, {})[column] = array
    try:
        found: dict[str, Any] = {name: numbers[name] for name in NUMBERS}
        found |= {name: arrays[name] for name in ("displacement", "von_mises", "stress_error")}
        found |= {name: arrays[f"state/{name}"] for name in STATE}
        for group in GROUPS:
            found[group] = {name.split("/")[1]: each for name, each in arrays.items() if name.startswith(f"{group}/")}
        return StoredStep(
            index=int(numbers["index"]),
            stress=arrays["stress"].reshape(-1, 3, 3),
            contacts={name: StoredContact(**columns) for name, columns in contacts.items()},
            **found,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise MachineError(f"{path}: not a step of this version of stickslip") from error


def read_checkpoint(path: Path) -> tuple[StepResult, Plain]:
    """The result of a step to the same bits, and what the run needs to go on.

    Raises:
        DamagedError: cut short, or damaged.
        MachineError: it cannot be read, or is not a step.
    """
    arrays, _ = _arrays(path)
    try:
        text, content = (arrays.pop(f"{CHECKPOINT}/{name}") for name in (TEXT, BYTES))
        plain = from_arrays(text, content, arrays)
        return from_plain(plain["result"]), plain["going"]
    except (KeyError, TypeError, ValueError) as error:
        raise MachineError(f"{path}: not a step of this version of stickslip") from error


def _arrays(path: Path, but: str = "") -> tuple[dict[str, AnyArray], dict[str, float | int]]:
    """Read a step's file, see `read_arrays`; its name says which step it is.

    Raises:
        MachineError: it is that of another one.
    """
    arrays, numbers = read_arrays(path, but)
    if (index := numbers.get("index")) is not None and path.name.partition(".")[0] != f"{index:06d}":
        raise MachineError(f"{path}: is not that step: it is step {index}")
    return arrays, numbers


def _columns(contact: ContactState) -> dict[str, AnyArray]:
    found: dict[str, AnyArray] = {"status": np.asarray(contact.status, np.int8)}
    for name in (field.name for field in fields(StoredContact) if field.name != "status"):
        if getattr(contact, name) is None:
            continue
        values = np.asarray(getattr(contact, name), np.float64)
        found[name] = values if values.ndim == 1 else three(values)
    return found
