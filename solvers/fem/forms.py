"""The weak forms in UFL, and the one place where they are compiled and counted."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from geometry import dolfinx_versions as dx
from geometry.dolfinx_versions import ufl
from geometry.mesh.mesh import Mesh
from solvers.laws.compliance import Compliance
from solvers.parallel.counters import Counters
from solvers.scene.contact import Contact
from solvers.scene.course import Drive
from solvers.scene.scene import Scene

LoadForm = tuple[Drive, Any]  # what drives it in time, linear form in v at value 1
Field = Callable[..., tuple[Any, ...]]  # coordinates to components, with operators alone


def _drive(load: str, component: int) -> Drive:
    return lambda scene: scene.loads[load].amplitudes()[component]


@dataclass(frozen=True)
class Revolved:
    """A measure of the meridian plane, taken around the full circle: dx becomes 2 pi r dx."""

    measure: Any
    radius: Any

    def __rmul__(self, integrand: Any) -> Any:
        return (integrand * 2 * np.pi * self.radius) * self.measure


@dataclass(frozen=True)
class WeakForms:
    """Elasticity, loads and the normal-compliance work of a scene, on its mesh."""

    scene: Scene
    mesh: Mesh
    space: Any
    counters: Counters
    u: Any = field(init=False)
    v: Any = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "u", ufl.TrialFunction(self.space))
        object.__setattr__(self, "v", ufl.TestFunction(self.space))

    def volume(self, body: str, degree: int | None = None) -> Any:
        """Measure of a body."""
        if degree is None and self.mesh.degree > 1:
            degree = 2 * self.mesh.degree + self.mesh.axisymmetric
        metadata = {} if degree is None else {"quadrature_degree": degree}
        measure = ufl.Measure("dx", domain=self.mesh.domain, subdomain_data=self.mesh.cell_tags, metadata=metadata)
        return self._around(measure(self.mesh.bodies[body]))

    def boundary(self, side: str, degree: int | None = None) -> Any:
        """Measure of a side."""
        metadata = {} if degree is None else {"quadrature_degree": degree}
        measure = ufl.Measure("ds", domain=self.mesh.domain, subdomain_data=self.mesh.facet_tags, metadata=metadata)
        return self._around(measure(self.mesh.sides[side]))

    def _around(self, measure: Any) -> Any:
        """The full circle in an axisymmetric model."""
        return Revolved(measure, ufl.SpatialCoordinate(self.mesh.domain)[0]) if self.mesh.axisymmetric else measure

    def strain(self, u: Any) -> Any:
        """eps(u): (d, d); in axisymmetry (3, 3), x, y and hoop."""
        gradient = ufl.sym(ufl.grad(u))
        if not self.mesh.axisymmetric:
            return gradient
        hoop = u[0] / ufl.SpatialCoordinate(self.mesh.domain)[0]
        return ufl.as_matrix(
            [[gradient[0, 0], gradient[0, 1], 0], [gradient[1, 0], gradient[1, 1], 0], [0, 0, hoop]],
        )

    def stress(self, u: Any, body: str) -> Any:
        """sigma(u) [Pa], as large as the strain; in plane strain and plane stress the in-plane components."""
        material = self.scene.bodies[body]
        lame_mu, lame_lambda = material.lame_mu, material.lame_lambda
        if self.scene.model == "plane stress":
            lame_lambda = 2 * lame_lambda * lame_mu / (lame_lambda + 2 * lame_mu)
        mu, lame_lambda = self.constant(lame_mu), self.constant(lame_lambda)
        strain = self.strain(u)
        return 2 * mu * strain + lame_lambda * ufl.tr(strain) * ufl.Identity(strain.ufl_shape[0])

    def elasticity(self, u: Any = None) -> Any:
        """a(u, v) = sum over bodies of ∫ sigma(u) : eps(v) dx; the inner forces of a displacement Function u."""
        strain, u = self.strain(self.v), self.u if u is None else u
        return sum(ufl.inner(self.stress(u, b), strain) * self.volume(b) for b in self.scene.bodies)

    def gram(self, length: float) -> Any:
        """<u, v> = sum over bodies of E ∫ grad u : grad v + u . v / l^2 dx, l = `length` [m]: the product of H1.

        E is not in the source: it lets bodies give way beside each other as they do. One body's is a factor of Q,
        which the step takes up.
        """
        product = ufl.inner(ufl.grad(self.u), ufl.grad(self.v)) + self.constant(length**-2) * ufl.inner(self.u, self.v)
        return sum(self.constant(body.E) * product * self.volume(name) for name, body in self.scene.bodies.items())

    def loads(self) -> list[LoadForm]:
        """The scene's surface loads; effects add theirs."""
        found: list[LoadForm] = []
        normal = ufl.FacetNormal(self.mesh.domain)
        for name, load in self.scene.loads.items():
            ds = self.boundary(load.boundary)
            if load.pressure is not None:
                found.append((_drive(name, 0), -ufl.inner(normal, self.v) * ds))
                continue
            spread = self.constant(1 / self.area(load.boundary) if load.force is not None else 1.0)
            found += [(_drive(name, i), spread * self.v[i] * ds) for i, a in enumerate(load.amplitudes()) if a != 0]
        return found

    def field(self, components: Field) -> Any:
        """A vector field given as a function of the coordinates."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        return ufl.as_vector(components(*(x[i] for i in range(self.mesh.dim))))

    def balance(self, u: Any, body: str, sides: Iterable[str], degree: int) -> Any:
        """∫ -div sigma(u) . v dx + ∫ sigma(u) n . v ds: the loads on a body and its sides that call for a `field` u."""
        sigma, normal = self.stress(u, body), ufl.FacetNormal(self.mesh.domain)
        form = -ufl.inner(ufl.div(sigma), self.v) * self.volume(body, degree)
        return form + sum(ufl.inner(sigma * normal, self.v) * self.boundary(side, degree) for side in sides)

    def area(self, side: str) -> float:
        """Area of a side [m²], per metre of thickness in plane models [m]."""
        form = self.compile(self.constant(1.0) * self.boundary(side))
        return float(self.mesh.comm.allreduce(dx.fem.assemble_scalar(form)))

    def constant(self, value: float) -> Any:
        """A number that the compiled form takes at run time: other values need no other compilation."""
        return dx.fem.Constant(self.mesh.domain, value)

    def gap(self, contact: Contact) -> tuple[Any, Any]:
        """Initial gap g [m] and unit normal n towards the obstacle, exact at every point."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        obstacle = self.scene.obstacles[contact.against]
        distance = obstacle.distance([x[i] for i in range(self.mesh.dim)], ufl.sqrt)
        return distance + self.constant(contact.gap_offset), -ufl.grad(distance)

    def normal_compliance(self, u: Any, contact: Contact, law: Compliance) -> Any:
        """j_n(u, v) = ∫ c_n (u_n - g)_+^m_n v_n ds, u the displacement Function relative to the obstacle [m]."""
        gap, normal = self.gap(contact)
        penetration = ufl.max_value(ufl.inner(u, normal) - gap, 0)
        degree, side = contact.degree(self.mesh.degree), contact.surface
        return self.constant(law.c_n) * penetration**law.m_n * ufl.inner(self.v, normal) * self.boundary(side, degree)

    def compile(self, form: Any) -> Any:
        """Compiled (or loaded) form; counted."""
        self.counters.forms += 1
        return dx.compile_form(form)
