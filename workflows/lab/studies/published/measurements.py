"""The measurements: every study of the page with its parameters, cheapest first."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stickslip.solvers.method_registry import METHODS
from stickslip.workflows.lab.benchmarks.own_process import kept
from stickslip.workflows.lab.studies.finding import Row
from stickslip.workflows.lab.studies.published.contact import linear, slipping, solved, spectrum, springs, stepped
from stickslip.workflows.lab.studies.published.tangent import tangent
from stickslip.workflows.lab.studies.saddle_points import RULES, SOFTNESS

MEASURED: Mapping[str, Callable[..., list[Row]]] = {
    "linear": linear,
    "step": stepped,
    "h": solved,
    "mu": solved,
    "inner": solved,
    "given": solved,
    "chen": solved,
    "newton": solved,
    "omega": springs,
    "spectrum": spectrum,
    "tangent": tangent,
}
Mesh = tuple[int, int]
TIGHT = 1e-11  # tolerance tight enough to show the order of convergence
GIVEN = 0.006  # friction bound [Pa] at which a part of the base slips
MU, OMEGA = 0.3, 1e3  # of the ready scenes, and by default
INNER_RULES = ("elman-golub", "bramble-pasciak-vassilev")


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Meshes and parameters of each study; a mesh is the dimension and n, the number of cells over the height."""

    meshes: tuple[Mesh, ...] = ((2, 4), (2, 8), (2, 16), (2, 32), (3, 2), (3, 4), (3, 8))
    spectra: tuple[Mesh, ...] = ((2, 4), (2, 8), (2, 16), (2, 32), (3, 4), (3, 8), (3, 10))
    tangents: tuple[Mesh, ...] = ((2, 8), (2, 16), (2, 32), (2, 64), (3, 4), (3, 8), (3, 12))
    at: Mesh = (2, 16)  # for all studies that do not vary h
    mu: tuple[float, ...] = (0.0, 0.1, 0.3, 1.0, 3.0)
    omega: tuple[float, ...] = (1e1, 1e2, 1e3, 1e4, 1e5, 1e6)
    inner: tuple[float, ...] = (0.01, 0.1, 0.3, 0.6, 0.9)
    parts: tuple[float, ...] = (0.5, 0.9, 0.99, 1.01, 1.1)  # of the limit 2 / lambda_1
    methods: tuple[str, ...] = tuple(METHODS)
    rules: tuple[str, ...] = tuple(RULES)  # of the linear saddle points


SMALL = Sizes(
    meshes=((2, 4), (2, 8), (2, 16), (3, 2), (3, 4)),
    spectra=((2, 4), (2, 8), (2, 16), (3, 2), (3, 4)),
    tangents=((2, 8), (2, 16), (3, 4)),
    at=(2, 8),
    mu=(0.0, 0.3, 1.0),
    omega=(1e1, 1e3, 1e5),
    inner=(0.1, 0.6),
    rules=("exact", "CG, residual falls to .3", "worst residual, .3"),
)


@dataclass(frozen=True)
class Measurement:
    """One call of a study."""

    study: str
    keys: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Name of its file."""
        parts = [self.study, *(f"{key}-{value}" for key, value in self.keys.items())]
        return "_".join(parts).replace(" ", "-").replace("/", "-")

    def rows(self, folder: Path) -> list[Row]:
        """The rows: read if they were measured before, else measured."""
        return kept(folder / f"{self.name}.json", lambda: MEASURED[self.study](**self.keys))


def measurements(sizes: Sizes) -> Iterator[Measurement]:
    """All of them."""
    dim, n = sizes.at
    here = {"dim": dim, "n": n}
    for softness in SOFTNESS:
        for rule in sizes.rules:
            yield Measurement("linear", {"softness": softness, "rule": rule})
    for friction in ("stick", "coulomb"):
        for part in sizes.parts:
            yield Measurement("step", here | {"friction": friction, "part": part})
    for omega_factor in sizes.omega:
        yield Measurement("omega", here | {"omega_factor": omega_factor})
    for d, m in sizes.spectra:
        yield Measurement("spectrum", {"dim": d, "n": m})
    for d, m in sizes.meshes:
        for method in sizes.methods:
            yield Measurement("h", {"dim": d, "n": m, "method": method})
    yield from _with_friction(dim, here, sizes)
    for outer_metric in ("points", "jacobian"):
        chen = {"method": "nonlinear-uzawa", "normal": "compliance", "given": GIVEN, "tolerance": TIGHT}
        yield Measurement("chen", here | chen | {"outer_metric": outer_metric})
    for d, m in (sizes.at, *[mesh for mesh in sizes.meshes if mesh[0] == 3][-1:]):
        yield Measurement(
            "newton", {"dim": d, "n": m, "method": "perturbed-lagrangian", "augment": False, "tolerance": TIGHT}
        )
    yield from _tangents(sizes)


def _with_friction(dim: int, here: Row, sizes: Sizes) -> Iterator[Measurement]:
    """The methods against mu, then inexact inner solves, on one mesh."""
    for mu in sizes.mu:
        for method in sizes.methods:
            yield Measurement("mu", here | {"method": method, "mu": mu, "drag": slipping(dim, mu)})
        given = {"method": "uzawa", "mu": mu, "drag": slipping(dim, mu), "friction_update": "outer"}
        yield Measurement("given", here | given)
    for method, normal in (("inexact-uzawa", "unilateral"), ("nonlinear-uzawa", "compliance")):
        for rule in INNER_RULES:
            for share in sizes.inner:
                keys = {"method": method, "normal": normal, "inner_rule": rule, "inner_tolerance": share}
                yield Measurement("inner", here | keys)


def _tangents(sizes: Sizes) -> Iterator[Measurement]:
    """The slip tangent against h; then against omega and mu on one mesh."""
    cases = [(mesh, MU, OMEGA) for mesh in sizes.tangents]
    cases += [(sizes.at, MU, omega) for omega in sizes.omega]
    cases += [(sizes.at, mu, OMEGA) for mu in sizes.mu]
    for (d, n), mu, omega in dict.fromkeys(cases):
        yield Measurement("tangent", {"dim": d, "n": n, "mu": mu, "omega_factor": omega})
