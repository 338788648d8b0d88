"""The command line, stickslip COMMAND ...: what it reads, and how it ends."""

from __future__ import annotations

import io
import json
import logging
import os
import shlex
import signal
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from stickslip import VERSION
from stickslip.geometry.errors import InputError, SceneError, StickslipError, shortened
from stickslip.workflows.commands.process import BEGAN, STOPPED, STOPPING, leave_together, refused, speaks

LONGEST = 280  # letters of a refusal
WHEEL = f"stickslip-{VERSION}-py3-none-any.whl"  # as `make dist` builds it
LIBRARIES = (
    f"dolfinx, gmsh and h5py come from Debian, from conda-forge, or by pip install '{WHEEL}[wheels]' "
    "(Linux on x86_64, Python 3.12 or later)"
)

app = typer.Typer(
    help="Frictional contact between elastic bodies in FEniCSx.",
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _scenes(begun: str) -> list[str]:
    """What a shell completes to a scene: ready scenes, and files and folders here; it knows other paths itself."""
    ready, here = Path(__file__).parents[1] / "scenes", Path()
    files = [path.name for path in here.glob("*.toml")] + [f"{path.name}/" for path in here.iterdir() if path.is_dir()]
    return [
        name for name in sorted(path.stem for path in ready.glob("*.toml")) + sorted(files) if name.startswith(begun)
    ]


SceneArgument = Annotated[
    str, typer.Argument(metavar="SCENE", help="a scene file, or a ready scene's name", autocompletion=_scenes)
]
UnitOption = Annotated[
    str | None,
    typer.Option("--unit", metavar="UNIT", help="of the geometry file: mm, in, ... [STEP: mm; else the scene's]"),
]
UnitsOption = Annotated[
    str | None, typer.Option("--units", metavar="UNITS", help="of the scene, such as mm-N-MPa [SI]")
]
WithinOption = Annotated[
    float | None, typer.Option("--within", metavar="LENGTH", help="largest gap of a pair [.001 of the assembly's size]")
]
SetOption = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="override a key of the scene")]


@app.command("run")
def run_command(
    scene: SceneArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME]")] = None,
    override: SetOption = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on where an earlier run of it was stopped")] = False,
    accuracy: Annotated[
        list[str] | None,
        typer.Option("--accuracy", metavar="NUMBER=1%", help="refine until the error of a number is below this"),
    ] = None,
    budget: Annotated[float | None, typer.Option("--budget", metavar="SECONDS", help="for --accuracy [600]")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="print result.json in place of the table")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but errors")] = False,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="one line an iteration")] = False,
) -> None:
    """Solve a scene and write its results."""
    from stickslip.workflows.accuracy.rounds import aiming
    from stickslip.workflows.accuracy.solve import run
    from stickslip.workflows.commands.mesh import announce
    from stickslip.workflows.run.result import json_text
    from stickslip.workflows.run.terminal import Reporter
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = aiming(read(scene, override or ()), accuracy or (), budget)
    folder = output or Path("results") / find(scene).stem
    if not quiet and speaks():
        announce(loaded)
    reporter = Reporter(quiet=quiet or not speaks(), verbose=verbose)
    with reporter, named(scene, override or ()):
        outcome, content = run(loaded, folder, reporter.watch(), resume, began=BEGAN)
    if as_json:
        typer.echo(json_text(content))
    else:
        reporter.table(content)
        reporter.files(outcome)
    if outcome.sentence and speaks():
        again = [
            "stickslip",
            "run",
            scene,
            "-o",
            str(folder),
            *(f"--set={word}" for word in override or ()),
            *(f"--accuracy={word}" for word in accuracy or ()),
            *([f"--budget={budget:g}"] if budget is not None else []),
            "--resume",
        ]
        how = f"; go on with: {shlex.join(again)}" if outcome.status == "interrupted" else ""
        typer.echo(f"stickslip: {outcome.status.replace('_', ' ')}: {outcome.sentence}{how}", err=True)
    sys.exit(outcome.exit_code)


@app.command("report")
def report_command(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="results of a run")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.html", help="[FOLDER/report.html]")
    ] = None,
) -> None:
    """Make a page of a run's results: numbers, pictures, cost, audit, the bodies in 3D; it opens without a network."""
    from stickslip.workflows.commands.report import report

    typer.echo(f"wrote {report(folder, output)}")


@app.command("compare")
def compare_command(
    a: Annotated[Path, typer.Argument(metavar="A", help="results of a run")],
    b: Annotated[Path, typer.Argument(metavar="B", help="results of another one")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="FILE.html", help="write them as a page too")
    ] = None,
) -> None:
    """Lay the results of two runs side by side: what was asked differently, numbers with ±, prices."""
    from stickslip.workflows.commands.compare import compare_folders

    compare_folders(a, b, output)


@app.command("plan")
def plan_command(
    scene: SceneArgument,
    override: SetOption = None,
    mesh: Annotated[bool, typer.Option("--mesh", help="mesh it too, and count")] = False,
    cost: Annotated[bool, typer.Option("--cost", help="tell what 10, 1, .1 % of its numbers will take")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="for scripts")] = False,
) -> None:
    """Say which effects a scene switches on, and why, without solving; with --cost from coarse versions of it."""
    from stickslip.solvers.simulation.memory import foretold
    from stickslip.solvers.simulation.plan import make_plan, warnings
    from stickslip.workflows.run.terminal import print_plan
    from stickslip.workflows.scene_file.read import named, read

    loaded = read(scene, override or ())
    with named(scene, override or ()):
        rows = make_plan(loaded)
    content: dict[str, Any] = {
        "title": loaded.title,
        "model": loaded.model,
        "units": loaded.units,
        "method": loaded.solver.method,
        "times": list(loaded.requested_times()),
        "effects": [asdict(row) for row in rows],
        "warnings": list(warnings(loaded)),
        "memory": None if mesh else foretold(loaded),
    }
    if mesh:
        from stickslip.workflows.commands.mesh import announce
        from stickslip.workflows.run.mesh_report import count

        if speaks():
            announce(loaded)
        with named(scene, override or ()):
            content["mesh"] = count(loaded)
        content["memory"] = content["mesh"].pop("memory")
    if speaks() and not as_json:
        print_plan(content)
    if cost:
        from stickslip.workflows.cost.foresee import foresee
        from stickslip.workflows.cost.progress import print_prices

        with named(scene, override or ()):
            foreseen = foresee(loaded)
        content["cost"] = [asdict(row) for row in foreseen]
        if speaks() and not as_json:
            print_prices(foreseen)
    if speaks() and as_json:
        typer.echo(json.dumps(content, indent=1, ensure_ascii=False))


@app.command("mesh")
def mesh_command(
    scene: SceneArgument,
    override: SetOption = None,
    gui: Annotated[bool, typer.Option("--gui", help="open the geometry in gmsh's window")] = False,
    listed: Annotated[bool, typer.Option("--list", help="bodies, sides, and numbered faces in a picture")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE.msh", help="write the mesh")] = None,
) -> None:
    """Mesh a scene and judge its mesh, without solving."""
    from stickslip.workflows.commands.mesh import announce, edit, list_entities, report
    from stickslip.workflows.scene_file.read import find, named, read, read_geometry

    if listed or gui:
        model, geometry, units = read_geometry(scene, override or ())
        with named(scene, override or ()):
            if listed:
                list_entities(geometry, model, units, Path(f"{find(scene).stem}_faces.png"))
            if gui:
                edit(geometry, model)
    if output is not None or not (listed or gui):
        loaded = read(scene, override or ())
        if speaks():
            announce(loaded)
        with named(scene, override or ()):
            report(loaded, output)


@app.command("cost")
def cost_command(
    scene: SceneArgument,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME_cost]")] = None,
    budget: Annotated[float, typer.Option("--budget", metavar="SECONDS", help="for all runs together")] = 300.0,
    quantity: Annotated[
        list[str] | None, typer.Option("--quantity", metavar="NAME", help="e.g. base.normal_force, energy.stored")
    ] = None,
    methods: Annotated[
        str | None,
        typer.Option(
            "--methods",
            metavar="NAME,NAME",
            help="lay these side by side on the same meshes; NAME+KEY=VALUE sets a key",
        ),
    ] = None,
    override: SetOption = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on with the runs of an earlier study")] = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but the sentence")] = False,
) -> None:
    """Show what accuracy costs in time: mesh sizes, orders, methods, tolerances."""
    from stickslip.workflows.cost.command import cost
    from stickslip.workflows.cost.progress import Teller
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = read(scene, override or ())
    folder = output or Path("results") / f"{find(scene).stem}_cost"
    with named(scene, override or ()):
        beside = [name.strip() for name in methods.split(",")] if methods is not None else []
        answer = cost(loaded, folder, budget, quantity or (), resume, Teller(budget, quiet), beside)
    typer.echo(answer.sentence)
    if answer.complaint:
        typer.echo(f"stickslip: {answer.complaint}", err=True)
    sys.exit(answer.exit_code)


@app.command("sweep")
def sweep_command(
    scene: SceneArgument,
    over: Annotated[
        list[str], typer.Argument(metavar="KEY=[VALUES]...", help="e.g. contacts.base.friction.mu=[0.1, 0.2, 0.3]")
    ],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="results folder [results/NAME_sweep]")] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="number of processes; under mpirun the ranks are taken")] = 1,
    override: SetOption = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="say nothing but errors")] = False,
) -> None:
    """Solve a scene with many values of some keys; what is solved already is not solved again."""
    from stickslip.workflows.commands.sweep import sweep_scene
    from stickslip.workflows.scene_file.read import find, named, read

    loaded = read(scene, override or ())
    with named(scene, override or ()):
        path = find(scene)
        folder = output or Path("results") / f"{path.stem}_sweep"
        code = sweep_scene(loaded, over, path.parent, folder, jobs, quiet)
    sys.exit(code)


@app.command("fclib")
def fclib_command(
    files: Annotated[list[Path], typer.Argument(metavar="FILES...", help="discrete problems in FCLIB's HDF5 format")],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="for copies of the files with their solutions")
    ] = Path("results/fclib"),
    method: Annotated[
        list[str] | None, typer.Option("--method", metavar="NAME", help="repeat to compare; all: every one [auto]")
    ] = None,
    tolerance: Annotated[
        float, typer.Option("--tolerance", help="on the residual, relative to the norm of q after scaling")
    ] = 1e-8,
    report: Annotated[
        Path | None, typer.Option("--json", metavar="FILE", help="write the figures, for scripts")
    ] = None,
) -> None:
    """Solve discrete Coulomb problems of non-smooth contact dynamics, and compare methods on them."""
    from stickslip.workflows.commands.fclib import fclib

    raise typer.Exit(fclib(files, output, method or (), tolerance, report))


@app.command("scenes")
def scenes_command() -> None:
    """List the ready scenes."""
    from stickslip.workflows.scene_file.read import READY, title_of

    for path in sorted(READY.glob("*.toml")):
        typer.echo(f"{path.stem:<12} {title_of(path)}")


@app.command("schema")
def schema_command(
    of: Annotated[str, typer.Argument(metavar="[scene|result]", help="scene files, or result.json")] = "scene",
) -> None:
    """Print the JSON schema of scene files, by which editors complete and check them, or that of result.json."""
    from stickslip.workflows.commands.schema import schema

    if speaks():
        typer.echo(schema(of))


@app.command("contacts")
def contacts_command(
    source: Annotated[str, typer.Argument(metavar="FILE", help="a geometry file, or a scene with one")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="for a picture of each pair [NAME_contacts]")
    ] = None,
    unit: UnitOption = None,
    units: UnitsOption = None,
    within: WithinOption = None,
) -> None:
    """List and draw the pairs of faces of an assembly that touch, or lie close to each other."""
    from stickslip.workflows.commands.contacts import list_contacts

    list_contacts(source, unit, units, within, output)


@app.command("new")
def new_command(
    name: Annotated[str | None, typer.Argument(metavar="[NAME]", help="a ready scene to start from")] = None,
    file: Annotated[Path | None, typer.Argument(metavar="[FILE]", help="where to put it [NAME.toml]")] = None,
    source: Annotated[
        Path | None, typer.Option("--from", metavar="GEOMETRY", help="write a scene for a geometry file instead")
    ] = None,
    unit: UnitOption = None,
    units: UnitsOption = None,
    within: WithinOption = None,
) -> None:
    """Copy a ready scene to a file of one's own, or write one for the contacts of an assembly."""
    from stickslip.workflows.commands.new import copy_ready

    if source is not None:
        from stickslip.workflows.commands.contacts import stem, write_scene

        if file is not None:
            raise SceneError(f"--from {source}: takes one name, that of the scene to write; found {name} and {file}")
        write_scene(source, unit, units, within, Path(name or f"{stem(source)}.toml"))
        return
    if name is None:
        raise SceneError("new: name a ready scene (stickslip scenes lists them), or a geometry file with --from")
    if (unit, units, within) != (None, None, None):
        raise SceneError("new: --unit, --units and --within belong to --from")
    if speaks():
        copy_ready(name, file or Path(f"{name}.toml"))


@app.callback(invoke_without_command=True)
def start(
    context: typer.Context, version: Annotated[bool, typer.Option("--version", help="print the version")] = False
) -> None:
    """Frictional contact between elastic bodies in FEniCSx."""
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
        if isinstance(error, ImportError) or error.errno is None:  # a library that does not fit under `ulimit -v`
            return _say(f"{shortened(error, 200)}; a library, a file or memory is missing (see ulimit -v)", 4)
        return _say(f"{error.filename or 'what is printed cannot be written'}: {error.strerror or error}", 4)
    except SystemExit as ended:  # a command that has said how it ended; or rich, if the reader of stdout has gone
        return ended.code if isinstance(ended.code, int) else 1
    except MemoryError:
        return _say("out of memory: use a larger mesh_size", 4)
    if code == STOPPED:  # typer returns it for KeyboardInterrupt
        return _say("interrupted", STOPPED)
    return code if isinstance(code, int) else 0


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
    import_module("stickslip.workflows.lab.commands.command")  # it adds its own
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
