"""Frictional contact between elastic bodies in FEniCSx: all that a script imports.

A first script
--------------
>>> import stickslip
>>> scene = stickslip.read("block", ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"])
>>> for step in stickslip.steps(scene):
...     base = step.contacts["base"]
...     print(f"t = {step.time} s: N = {base.normal_force:.3f} N, T = {base.tangential_force:.3f} N")
t = 1.0 s: N = 0.246 N, T = 0.000 N
t = 2.0 s: N = 0.245 N, T = 0.033 N

Six ways to solve a scene, and one to read results
--------------------------------------------------
steps(scene)
    yields a `StepResult` for each requested time; writes nothing.
run(scene, folder)
    does what `stickslip run` does: solves, writes all files, audits them, draws the pictures.
prepare(scene)
    returns a `Simulation`: meshed, assembled and factorised once. `.steps()` solves the scene's
    history, `.data` is the mesh as arrays (`MeshData`), `.plan` lists the effects and why each is on.
sweep(scene, {"contacts.base.friction.mu": [0.1, 0.2]}, folder)
    runs it with other values, in processes beside each other; `.rows` and `.to_pandas()` are its table.
fit(scene, {"time": times, "support.top.force.x": forces}, ["contacts.base.friction.mu"])
    finds numbers for which its history fits a measured one; `.values`, `.covariance`, `.not_told`.
prepare(scene).script()
    returns a `Script`, which is told each step: `script.step(to=1.0, supports={"top": {"x": 0.01}})`.
    All that a scene gives in time may change: loads, gaps, gravity, temperatures, bolts, remote points.
    `script.limit("loads.pull.x")` finds the largest load that contact and friction bear from there.

load(folder)
    gives back what a run has left: `.steps` are the same `StepResult`s, `.mesh` the mesh, `.result` the
    content of result.json, `.columns` and `.to_pandas()` the table of the steps.

`read` takes a scene file, or the name of a ready scene. A `Scene` can also be built from its parts,
which have the names of the file's tables and keys:

    Scene(model="3d", geometry=Block(...), bodies={"block": Material(E=2e11, nu=0.3, density=7850.0)},
          gravity=Gravity(...), ...)

All parts are frozen; `dataclasses.replace` makes a changed copy. workflows/SCENE.md lists every key
with type, unit and default.

What a step holds
-----------------
step.contacts["base"]   a `ContactState`: at each node of the slave side (n,) pressure, gap, status and
                        friction bound, (n, d) points, traction and slip; of the whole side force,
                        moment, and the areas that touch, stick and slip; `.to_pandas()`: its nodes
step.sums               numbers of each contact with several partners, by name; `contacts` has each alone
step.displacement       (nodes, d) [m]
step.stress             (cells, 3, 3) [Pa]; step.von_mises (cells,) [Pa]
step.bodies             a `BodyState` by name: largest displacement [m] and von Mises stress [Pa]
step.supports           reactions by name: force (d,) [N] and moment [N m]
step.elastic_support    what springs per area exert: force (d,) [N] and moment [N m] by name
step.springs, .bolts    forces (d,) [N] by name; tension [N] and shortening [m]
step.remote_points      displacement [m], rotation [rad], force [N] and moment [N m] by name
step.obstacles          displacement (d,) [m], force (d,) [N] and moment [N m] by name
step.probes             displacement (d,) [m] and stress (3, 3) [Pa] at points, by name
step.energy             an `Energy` [J]
step.NAME               so any other table that an effect reports, as step.plungers["stop"].force [N]
step.residual           how well equilibrium and contact laws are satisfied, relative

A status is `OPEN`, `SLIP` or `STICK`: `base.status == stickslip.STICK` is a mask (n,).

Units and signs
---------------
Units are SI; any consistent set works, and `Scene(units="mm-N-MPa")` labels tables and pictures with
it. No number is converted. d is 2 or 3. In plane models forces, areas and energies are per
metre of thickness; in axisymmetric ones they are of the full circle, and x is the radius. Pressure is
positive where it presses, a gap is positive where it is open. Tractions, force and moment of a contact
act on the side that the scene calls `surface`, and slips are that side's relative to the other one,
whichever is the slave. Displacements are measured from the undeformed mesh.

Under mpirun all functions are collective: every rank calls them. Fields (displacement, stress,
`MeshData`) are on rank 0 and empty elsewhere; all other results are on every rank.

Errors
------
All derive from `StickslipError`; the text is one line. `SceneError` (with `FolderError`) and
`GeometryError` are about input and are raised before solving. `SolverError` is about a step:
`StepError` has its iterations in `.history`; it is a `NoEquilibriumError` where it is shown that
nothing can balance the loads. `MachineError` (with `DamagedError`) is about disk, memory, libraries.

Names
-----
Functions         read, prepare, steps, run, sweep, fit, load
Scene             Scene, Material, Orthotropic, Contact, Support, Load, Probe, Steps, Clock, Cycle,
                  Solver, Initial, Gram, Output, Exact, Accuracy, Sensitivity
Geometry          UserFile, Box; builders: Arch, Block, Cylinders, HalfBall, HalfDisc, HalfSpace, Ring,
                  Rings, Spheres, Stack, Strip, TwoBlocks, Wedge
Obstacles         Plane, Cylinder, Sphere, Cone, Rotation
Normal laws       Unilateral, Compliance, Bilateral, Tied
Friction, wear    Coulomb, CappedCoulomb, Cohesion, OrthotropicCoulomb, PressureDependent,
                  RateDependent, SlipDependent, StaticKinetic, Stick, TangentialCompliance, Tresca; Wear
Effects           BodyForce, Bolt, Centrifugal, ElasticSupport, Gravity, Periodic, Plunger, RemotePoint,
                  Spring, Thermal
Solving           Simulation, Script, Limit, PlanRow, Seconds, Counters; iterations: HistoryRow,
                  HistoryTuple, Step, Status
Results           StepResult, ContactState, ContactNumbers, OPEN, SLIP, STICK, BodyState, Reaction,
                  ObstacleState, SpringForce, BoltState, RemoteState, ProbeValue, Energy, Event,
                  Batch, MeshData, SurfaceMesh, Convergence; errors: Quantity, ErrorParts;
                  derivatives: Slope
Runs              Watch (callbacks of `run`), MeshReport, ContactReport, Outcome (how a run ended);
                  Loaded; sweeps: Sweep, Solved; calibration: Fit
Errors            StickslipError, SceneError, FolderError, GeometryError, SolverError, StepError,
                  NoEquilibriumError, MachineError, DamagedError
Bases             Builder, Obstacle, NormalLaw, FrictionLaw, Key, Number: to write a kind of one's own

A kind that a new file in geometry/builders, geometry/obstacles, solvers/laws or solvers/effects adds is
public here at once.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

VERSION = __version__ = "0.2.0"


def __getattr__(name: str) -> Any:
    """A public name: what it needs, dolfinx and PETSc among it, is imported when it is first asked for.

    Raises:
        AttributeError: there is none of this name.
    """
    if name.startswith("__") and name != "__all__":
        raise AttributeError(f"module 'stickslip' has no attribute {name!r}")
    return getattr(import_module("stickslip.public"), name)


def __dir__() -> list[str]:
    """All public names, those of new kinds included."""
    return sorted({*import_module("stickslip.public").names(), "__doc__", "__file__", "__version__"})
