"""The weak forms in UFL; they are compiled and counted here only."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from math import prod
from typing import Any

import numpy as np

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array
from stickslip.geometry.dolfinx_versions import ufl
from stickslip.geometry.field import number
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.protocols import (
    CompiledForm,
    Constant,
    DolfinxMesh,
    Function,
    FunctionSpace,
    Measure,
    MeshTags,
    UflExpr,
    UflForm,
    Vec,
)
from stickslip.solvers.fem.terms import InitialStrain, LoadTerm, drawn_together
from stickslip.solvers.laws.normal import Compliance
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.scene.contact import Contact
from stickslip.solvers.scene.loads import Springs
from stickslip.solvers.scene.material import DOUBLED, PAIRS, Orthotropic
from stickslip.solvers.scene.problem import Problem
from stickslip.solvers.scene.timeline import Place

Field = Callable[..., tuple[Any, ...]]  # from coordinates to components, by arithmetic operators only
SYMBOLS: Mapping[str, Callable[..., Any]] = {
    "sin": ufl.sin, "cos": ufl.cos, "tan": ufl.tan, "exp": ufl.exp, "sqrt": ufl.sqrt, "log": ufl.ln, "abs": abs,
    "min": ufl.min_value, "max": ufl.max_value,
}  # fmt: skip


def compliant_pressure(c_n: UflExpr, m_n: float, penetration: UflExpr) -> UflExpr:
    """p_n = c_n (u_n - g)_+^m_n [Pa], the density of j_n; c_n: a constant [Pa/m^m_n], penetration: u_n - g [m]."""
    return c_n * ufl.max_value(penetration, 0) ** m_n


def multiplied(form: UflForm, factors: Mapping[str, Function]) -> UflForm | None:
    """The form with some of its integrals multiplied, without the others; None: nothing is left.

    Args:
        factors: by the type of the integral, as UFL names it: cell, exterior_facet.
    """
    kept = [integral for integral in form.integrals() if integral.integral_type() in factors]
    if not kept:
        return None
    return ufl.Form([one.reconstruct(integrand=factors[one.integral_type()] * one.integrand()) for one in kept])


def numbered(form: UflForm, domain: DolfinxMesh) -> UflForm:
    """The form with the bodies and the sides that it is over numbered from 1 on, in place of their numbers in the mesh.

    A compiled form holds these numbers: so the weights of a hundred bodies are compiled once, not a hundred times.
    """
    numbers, tags = dict[str, list[int]](), dict[str, MeshTags]()  # by the type of the integral
    for one in form.integrals():
        if one.subdomain_data() is not None:
            tags[one.integral_type()] = one.subdomain_data()
            known = numbers.setdefault(one.integral_type(), [])
            if one.subdomain_id() not in known:
                known.append(one.subdomain_id())
    own = {kind: dx.renumbered(domain, tags[kind], known) for kind, known in numbers.items()}

    def changed(one: Any) -> Any:  # dolfinx 0.9 asks that integrals of one type have one object as their data
        kind = one.integral_type()
        number = one.subdomain_id() if one.subdomain_data() is None else numbers[kind].index(one.subdomain_id()) + 1
        return one.reconstruct(subdomain_id=number, subdomain_data=own.get(kind))

    return ufl.Form([changed(one) for one in form.integrals()])


@dataclass(frozen=True)
class Revolved:
    """A measure of the meridian plane, extended to the full circle: dx becomes 2 pi r dx."""

    measure: Measure
    radius: UflExpr

    def __rmul__(self, integrand: UflExpr) -> UflForm:
        return (integrand * 2 * np.pi * self.radius) * self.measure


@dataclass(frozen=True)
class WeakForms:
    """Elasticity, loads and the normal-compliance work of a scene, on its mesh."""

    problem: Problem
    mesh: Mesh
    space: FunctionSpace
    counters: Counters
    degree: int | None = None  # of the quadrature on cells; None: that of the mesh
    smooth: int = 4  # that of an expression, beyond twice the order, but where a form asks for more

    @cached_property
    def u(self) -> UflExpr:
        """Trial function."""
        return ufl.TrialFunction(self.space)

    @cached_property
    def v(self) -> UflExpr:
        """Test function."""
        return ufl.TestFunction(self.space)

    def volume(self, body: str, degree: int | None = None) -> Measure:
        """Volume measure of a body; `degree`: of the quadrature, None: the default."""
        domain, tags = self.mesh.domain, self.mesh.cell_tags
        measure = ufl.Measure("dx", domain=domain, subdomain_data=tags, metadata=self._rule(degree))
        return self._around(measure(self.mesh.bodies[body]))

    def _rule(self, degree: int | None = None) -> dict[str, int]:
        """Metadata of a measure of cells; `degree`: of the quadrature, None: the default."""
        found = next((each for each in (degree, self.degree, self.mesh.quadrature) if each is not None), None)
        return {} if found is None else {"quadrature_degree": found}

    def boundary(self, side: str, degree: int | None = None) -> Measure:
        """Surface measure of a side; `degree`: of the quadrature, None: the default."""
        metadata = {} if degree is None else {"quadrature_degree": degree}
        measure = ufl.Measure("ds", domain=self.mesh.domain, subdomain_data=self.mesh.facet_tags, metadata=metadata)
        return self._around(measure(self.mesh.sides[side]))

    def skin(self) -> Measure:
        """Surface measure of all of the surface, planes of symmetry included, as the mesh lies."""
        return ufl.Measure("ds", domain=self.mesh.domain)

    def _around(self, measure: Measure) -> Measure:
        """The measure, in an axisymmetric model over the full circle."""
        return Revolved(measure, ufl.SpatialCoordinate(self.mesh.domain)[0]) if self.mesh.axisymmetric else measure

    def strain(self, u: UflExpr) -> UflExpr:
        """eps(u) [-]: (d, d); in axisymmetric models (3, 3), x, y and hoop."""
        gradient = ufl.sym(ufl.grad(u))
        if not self.mesh.axisymmetric:
            return gradient
        hoop = u[0] / ufl.SpatialCoordinate(self.mesh.domain)[0]
        return ufl.as_matrix([[gradient[0, 0], gradient[0, 1], 0], [gradient[1, 0], gradient[1, 1], 0], [0, 0, hoop]])

    def stress(self, u: UflExpr, body: str) -> UflExpr:
        """sigma(u) [Pa], with the shape of the strain; in plane strain and plane stress the in-plane components."""
        if body in self.problem.orthotropic:
            return self._along_axes(self.strain(u), self.problem.orthotropic[body])
        first, mu = self.lame(body)
        return self._stress(u, self.constant(first), self.constant(mu))

    def lame(self, body: str) -> tuple[float, float]:
        """Lamé parameters [Pa] of the stress of an isotropic body; in plane stress the first one is reduced."""
        material = self.problem.isotropic[body]
        first, mu = material.lame_lambda, material.lame_mu
        return (2 * first * mu / (first + 2 * mu) if self.problem.model == "plane stress" else first), mu

    def _stress(self, u: UflExpr, first: UflExpr, mu: UflExpr) -> UflExpr:
        strain = self.strain(u)
        return 2 * mu * strain + first * ufl.tr(strain) * ufl.Identity(strain.ufl_shape[0])

    def _along_axes(self, strain: UflExpr, material: Orthotropic) -> UflExpr:
        """sigma = C eps [Pa], with the shape of the strain; C is read at run time."""
        size = strain.ufl_shape[0]
        pairs = [k for k, (i, j) in enumerate(PAIRS) if max(i, j) < size and (k < 4 or self.mesh.dim == 3)]
        C = self.constant(material.stiffness_in(self.problem.model == "plane stress")[np.ix_(pairs, pairs)])
        six = C * ufl.as_vector([float(DOUBLED[k]) * strain[PAIRS[k]] for k in pairs])
        place = {PAIRS[k]: n for n, k in enumerate(pairs)}
        rows = [[(min(i, j), max(i, j)) for j in range(size)] for i in range(size)]
        return ufl.as_matrix([[six[place[ij]] if ij in place else 0 for ij in row] for row in rows])

    def elasticity(self, u: UflExpr | None = None) -> UflForm:
        """a(u, v) = sum over bodies of ∫ sigma(u) : eps(v) dx, without the part of `MeanDilatation`: there 2 mu eps(u).

        Lamé parameters are read cell by cell: one compiled form for any number of isotropic bodies.

        Args:
            u: displacement Function, for the linear form of its inner forces; None: the trial function.
        """
        strain, u, problem = self.strain(self.v), self.u if u is None else u, self.problem
        found = sum(ufl.inner(self.stress(u, b), strain) * self.volume(b) for b in problem.orthotropic)
        if problem.isotropic:
            stress = self._stress(u, *self._lame_by_cell())
            everywhere = ufl.Measure("dx", domain=self.mesh.domain, metadata=self._rule())
            found += ufl.inner(stress, strain) * self._around(everywhere)
        return found

    def _lame_by_cell(self) -> tuple[Function, Function]:
        """Lamé parameters [Pa]; 0 in orthotropic bodies, the first one also where the dilatation is a mean."""
        domain = self.mesh.domain
        index = domain.topology.index_map(self.mesh.dim)
        first, mu = np.zeros((2, index.size_local + index.num_ghosts))
        for body in self.problem.isotropic:
            cells = self.mesh.cells_of(body)
            first[cells], mu[cells] = self.lame(body)
            if body in self.problem.averaged:
                first[cells] = 0.0
        return dx.cell_function(domain, first), dx.cell_function(domain, mu)

    def gram(self, length: float) -> UflForm:
        """<u, v> = sum over bodies of E ∫ grad u : grad v + u . v / l^2 dx, l = `length` [m]: the inner product of H1.

        E, of orthotropic bodies `Elastic.modulus`, is not in the source: it weights each body by its stiffness. With a
        single body it is only a factor of Q, which the step size alpha = relaxation / lambda_max cancels.
        """
        product = ufl.inner(ufl.grad(self.u), ufl.grad(self.v)) + self.constant(length**-2) * ufl.inner(self.u, self.v)
        return sum(
            self.constant(body.modulus) * product * self.volume(name) for name, body in self.problem.bodies.items()
        )

    def initial_stress(self, initial: InitialStrain) -> Array:
        """sigma = C strain (3, 3) [Pa] of an initial strain at value 1; in plane stress sigma_zz = 0."""
        return self.problem.bodies[initial.body].stress(initial.strain, self.problem.model == "plane stress")

    def initial_load(
        self, initial: InitialStrain, shrinking: Function | None = None, mean: Function | None = None
    ) -> UflForm:
        """∫ sigma : eps(v) dx with `initial_stress`: the load of the initial strain at value 1 [N].

        Args:
            shrinking: in place of `shrinking` in this space, for a bolt.
            mean: dilatation of the strain [-] in place of that at the point, see `MeanDilatation.of_strain`.
        """
        if initial.shrunk is not None:
            drawn = self.shrinking(initial) if shrinking is None else shrinking
            return ufl.inner(self.stress(drawn, initial.body), self.strain(self.v)) * (self.volume(initial.body))
        strain, stress = self.strain(self.v), self.initial_stress(initial)
        if mean is not None:
            stress = 2 * self.lame(initial.body)[1] * initial.strain
        size = strain.ufl_shape[0]
        terms = [(i, j) for i in range(size) for j in range(size) if stress[i, j] != 0]
        density = sum(self.constant(float(stress[i, j])) * strain[i, j] for i, j in terms)
        if initial.field:
            density = self._value(initial.field, self.constant(0.0)) * density
        found = density * self._volume_of(initial)
        if mean is not None:
            found += self.constant(self.lame(initial.body)[0]) * mean * ufl.tr(strain) * self.volume(initial.body)
        return found

    def initial_energy(self, one: InitialStrain, other: InitialStrain, mean: Function | None = None) -> float:
        """∫ strain : C strain dx [J] of two initial strains of a body, both at value 1; collective.

        Args:
            mean: of the first one, see `initial_load`.
        """
        if one.shrunk is not None:
            forces = self.load_of(other).array_r
            work = forces @ self.shrinking(one).x.array[: len(forces)]
            return float(self.mesh.comm.allreduce(work))
        if other.shrunk is not None:
            return self.initial_energy(other, one)
        both = [self._value(field, self.constant(0.0)) for field in (one.field, other.field) if field]
        density = prod(both, start=self.constant(1.0))
        size = self._integral(density * self._volume_of(one if one.field else other))
        if mean is None:
            return float(size * np.sum(one.strain * self.initial_stress(other)))
        first, mu = self.lame(other.body)
        volume = self._integral(self.initial_dilatation(other, mean))
        return float(size * 2 * mu * np.sum(one.strain * other.strain) + first * volume)

    def initial_dilatation(self, initial: InitialStrain, weight: UflExpr) -> UflForm:
        """∫ weight tr(strain) dx [m³] of an initial strain at value 1."""
        size = self._value(initial.field, self.constant(0.0)) if initial.field else 1.0
        return weight * size * self.constant(float(np.trace(initial.strain))) * self._volume_of(initial)

    def load_of(self, initial: InitialStrain, mean: Function | None = None) -> Vec:
        """`initial_load` over all displacements [N]; collective."""
        return dx.assemble_vector(self.compile(self.initial_load(initial, mean=mean)))

    def shrinking(self, initial: InitialStrain) -> Function:
        """The displacement [m] whose strain an initial strain is, see `drawn_together`; ghosts included."""
        found = dx.fem.Function(self.space)
        d = self.mesh.dim
        points = self.space.tabulate_dof_coordinates()[:, :d]
        assert initial.shrunk is not None
        found.x.array[:] = drawn_together(points, *initial.shrunk).ravel()
        return found

    def strain_by_cell(self, u: Function) -> Callable[[], Array]:
        """Compile what gives the strain (own cells, 3, 3) [-] of a displacement at the cells' midpoints; collective."""
        domain = self.mesh.domain
        cells = np.arange(domain.topology.index_map(self.mesh.dim).size_local)
        compiled = dx.CellExpression(self.strain(u), dx.midpoint(domain), domain)
        self.counters.forms += 1

        def strain() -> Array:
            values, found = compiled(cells), np.zeros((len(cells), 3, 3))
            d = round(values.shape[-1] ** 0.5)
            found[:, :d, :d] = values.reshape(-1, d, d)
            return found

        return strain

    def _volume_of(self, initial: InitialStrain) -> Measure:
        return self.volume(initial.body, 2 * self.mesh.degree + self.smooth if initial.field else None)

    def loads(self) -> list[LoadTerm]:
        """The scene's surface loads; effects add theirs."""
        found: list[LoadTerm] = []
        normal = ufl.FacetNormal(self.mesh.domain)
        for name, load in self.problem.loads.items():
            on_side = partial(self.boundary, load.boundary)
            if load.pressure is not None:
                found.append(self.load(Place("loads", name, "pressure"), -ufl.inner(normal, self.v), on_side))
                continue
            spread = 1 / self.area(load.boundary) if load.force is not None else 1.0
            quantity = "force" if load.force is not None else "traction"
            found += [
                self.load(Place("loads", name, quantity, "xyz"[i]), self.along(i, spread), on_side)
                for i, a in enumerate(load.vector or ())
                if a != 0
            ]
        return found

    def load(self, place: Place, density: UflExpr, measure: Callable[[int | None], Measure]) -> LoadTerm:
        """The load ∫ value density dx, whose value is a value in time or an expression of the scene.

        Args:
            place: of the value in the scene.
            density: linear in the test function.
            measure: takes the degree of the quadrature, None: the default.
        """
        expression = self.problem.timeline.expressions.get(place)
        if expression is None:
            return LoadTerm(drive=place, form=density * measure(None))
        clock = self.constant(0.0)
        form = self._value(place, clock) * density * measure(2 * self.mesh.degree + self.smooth)
        return LoadTerm(drive=place, form=form, clock=clock if expression.in_time else None)

    def _value(self, place: Place, clock: Constant) -> UflExpr:
        """The expression at a place of the scene, without its ramp; clock: t [s]."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        values = {axis: x[i] for i, axis in enumerate("xyz"[: self.mesh.dim])} | {"t": clock}
        return self.problem.timeline.expressions[place].build(values, self.constant, SYMBOLS)

    def along(self, axis: int, factor: float = 1.0) -> UflExpr:
        """The component of v along an axis, times a factor; both are read at run time: one form for all axes."""
        return ufl.inner(self.constant(factor * np.eye(self.mesh.dim)[axis]), self.v)

    def linear(self, matrix: Array, shift: Array) -> UflExpr:
        """(matrix x + shift) . v, x the coordinates (d,) [m]."""
        x, rows = ufl.SpatialCoordinate(self.mesh.domain), range(self.mesh.dim)
        field = [sum(self.constant(matrix[i, j]) * x[j] for j in rows) + self.constant(shift[i]) for i in rows]
        return sum(field[i] * self.v[i] for i in rows)

    def field(self, components: Field) -> UflExpr:
        """A vector field given as a function of the coordinates."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        return ufl.as_vector(components(*(x[i] for i in range(self.mesh.dim))))

    def balance(self, u: UflExpr, body: str, sides: Iterable[str], degree: int) -> UflForm:
        """∫ -div sigma(u) . v dx + ∫ sigma(u) n . v ds: loads on a body and its sides under which u is the solution.

        Args:
            u: see `field`.
            degree: of the quadrature.
        """
        sigma, normal = self.stress(u, body), ufl.FacetNormal(self.mesh.domain)
        form = -ufl.inner(ufl.div(sigma), self.v) * self.volume(body, degree)
        return form + sum(ufl.inner(sigma * normal, self.v) * self.boundary(side, degree) for side in sides)

    def area(self, side: str) -> float:
        """Area of a side [m²], per metre of thickness in plane models [m]."""
        return self._integral(self.constant(1.0) * self.boundary(side))

    def size(self, body: str) -> float:
        """Volume of a body [m³], per metre of thickness in plane models [m²]."""
        return self._integral(self.constant(1.0) * self.volume(body))

    def _integral(self, form: UflForm) -> float:
        return float(self.mesh.comm.allreduce(dx.fem.assemble_scalar(self.compile(form))))

    def springs(self, springs: Springs, u: UflExpr) -> UflForm:
        """∫ (k_n u_n v_n + k_t u_t . v_t) ds of springs per area between a side and the ground.

        Args:
            u: trial function, or a displacement [m].
        """
        n = ufl.FacetNormal(self.mesh.domain)
        along, whole = ufl.inner(u, n) * ufl.inner(self.v, n), ufl.inner(u, self.v)
        stress = self.constant(springs.normal) * along + self.constant(springs.tangential) * (whole - along)
        return stress * self.boundary(springs.boundary)

    def rigid_motion(self, translation: Constant, rotation: Constant) -> UflExpr:
        """Translation (d,) plus rotation about the origin, (1,) in 2D and (3,) in 3D, times the place."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        turned = ufl.cross(rotation, x) if self.mesh.dim == 3 else rotation[0] * ufl.as_vector([-x[1], x[0]])
        return translation + turned

    def constant(self, value: float | Array) -> Constant:
        """A number or matrix that a compiled form reads at run time, so that other values need no new compilation."""
        return dx.fem.Constant(self.mesh.domain, value)

    def gap(self, contact: Contact) -> tuple[UflExpr, UflExpr]:
        """Initial gap g [m] and unit normal n towards the obstacle, exact at every point of the surface."""
        x = ufl.SpatialCoordinate(self.mesh.domain)
        obstacle = self.problem.obstacles[str(contact.against)]
        distance = obstacle.distance([x[i] for i in range(self.mesh.dim)], ufl.sqrt)
        return distance + self.constant(number(contact.gap_offset)), -ufl.grad(distance)

    def normal_compliance(self, u: UflExpr, contact: Contact, law: Compliance) -> UflForm:
        """j_n(u, v) = ∫ c_n (u_n - g)_+^m_n v_n ds, u the displacement Function relative to the obstacle [m]."""
        gap, normal = self.gap(contact)
        degree, side = contact.degree(self.mesh.degree), contact.surface
        pressure = compliant_pressure(self.constant(law.c_n), law.m_n, ufl.inner(u, normal) - gap)
        return pressure * ufl.inner(self.v, normal) * self.boundary(side, degree)

    def compile(self, form: UflForm) -> CompiledForm:
        """Compile a form, or load it from the cache; counted."""
        self.counters.forms += 1
        return dx.compile_form(numbered(form, self.mesh.domain))
