"""The command line, stickslip COMMAND ...: what it reads, and how it ends."""

from __future__ import annotations

import io
import logging
import os
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated

import typer

from stickslip import VERSION
from stickslip.geometry.errors import InputError, StickslipError, shortened
from stickslip.workflows.commands.process import STOPPED, STOPPING, leave_together, refused, speaks

LONGEST = 280  # letters of a refusal
WHEEL = f"stickslip-{VERSION}-py3-none-any.whl"  # as `make dist` builds it
LIBRARIES = (
    f"dolfinx, gmsh and h5py come from Debian, from conda-forge, or by pip install '{WHEEL}[wheels]' "
    "(Linux on x86_64, Python 3.12 or later)"
)

FIRST = "run report compare plan mesh cost sweep sensitivity fit verify fclib scenes schema contacts new"  # in --help
ROOMS = ("stickslip.workflows.commands", "stickslip.workflows.lab.commands")

app = typer.Typer(
    help="Frictional contact between elastic bodies in FEniCSx: small strain, linear elastic, quasi-static.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def commands() -> dict[str, Callable[..., None]]:
    """Commands by name, as they are listed: functions with the name of their file, in the rooms for commands.

    These files import little, for all are imported; what takes long is imported by the function, some of it from _NAME.
    """
    found = dict[str, Callable[..., None]]()
    for room in ROOMS:
        for module in iter_modules(import_module(room).__path__, f"{room}."):
            name = module.name.rpartition(".")[2]
            if not name.startswith("_") and hasattr(import_module(module.name), name):
                found[name] = getattr(import_module(module.name), name)
    return {name: found[name] for name in dict.fromkeys([*FIRST.split(), *sorted(found)]) if name in found}


for command in commands().values():
    app.command()(command)


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="print the version")] = False
) -> None:
    """Frictional contact between elastic bodies in FEniCSx: small strain, linear elastic, quasi-static."""
    if version or context.invoked_subcommand is None:
        typer.echo(VERSION if version else context.get_help())


def guarded(act: Callable[[], object]) -> int:
    """Call `act`, print every expected failure on stderr, in a line for each mistake, and return the exit code."""
    try:
        code = act()
    except InputError as error:
        for line in error.lines:
            _say(line, error.exit_code)
        return error.exit_code
    except StickslipError as error:
        return _say(str(error), error.exit_code)
    except typer.TyperException as error:
        text = str(error) or "see stickslip --help"
        return _say(text, 2)
    except (KeyboardInterrupt, typer.Abort):
        return _say("interrupted", STOPPED)
    except BrokenPipeError:
        raise
    except ModuleNotFoundError as error:
        return _say(f"{error}; {LIBRARIES}", 4)
    except (ImportError, OSError) as error:
        return _say(_missing(error), 4)
    except SystemExit as ended:  # a command that has said how it ended; or rich, if the reader of stdout has gone
        return ended.code if isinstance(ended.code, int) else 1
    except MemoryError:
        return _say("out of memory: use a larger mesh_size", 4)
    if code == STOPPED:  # typer returns it for KeyboardInterrupt
        return _say("interrupted", STOPPED)
    return code if isinstance(code, int) else 0


def _missing(error: ImportError | OSError) -> str:
    """Say which file fails; a library that does not fit under `ulimit -v` has none."""
    if isinstance(error, ImportError) or error.errno is None:
        return f"{shortened(error, 200)}; a library, a file or memory is missing (see ulimit -v)"
    return f"{error.filename or 'what is printed cannot be written'}: {error.strerror or error}"


def _say(text: str, code: int) -> int:
    """Print one line on stderr; return the exit code."""
    refused.append(f"stickslip: {shortened(text, LONGEST)}")
    if speaks():
        with suppress(OSError):  # nothing is left to tell it to
            print(refused[-1], file=sys.stderr, flush=True)
    return code


def main() -> None:
    """Run the command, and end the process; see `stickslip.workflows.commands.start`."""
    logging.getLogger().addHandler(logging.NullHandler())  # FFCx writes its compiler commands to the root logger
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # LANG=C knows no ², and names of files may be any bytes
    if not speaks():
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  until the process ends
    try:
        code = guarded(lambda: app(standalone_mode=False))
    except BrokenPipeError:
        code = 1
    except Exception:  # a mistake of ours
        traceback.print_exc()
        code = 1
    for number in STOPPING:  # Python and MPI end now
        signal.signal(number, signal.SIG_IGN)
    code = _flushed(code)
    leave_together(code)
    sys.exit(code)


def _flushed(code: int) -> int:
    """Flush stdout and stderr, and return the exit code, instead of Python's 120 where this fails.

    It is 1 if nothing reads stdout any more, 4 if the disk is full.
    """
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
            broken = isinstance(error, BrokenPipeError)
            code = code or (1 if broken else _say(f"what is printed cannot be written: {error.strerror}", 4))
    return code


if __name__ == "__main__":
    main()
