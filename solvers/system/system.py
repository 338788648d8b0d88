"""The scene on its mesh: K_B, loads, constraints and contact rows, assembled once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from petsc4py import PETSc
from scipy.linalg import block_diag

from stickslip.geometry import dolfinx_versions as dx
from stickslip.geometry.arrays import Array, Ints
from stickslip.geometry.errors import SceneError
from stickslip.geometry.mesh.mesh import Mesh
from stickslip.geometry.mesh.nodes import Nodes
from stickslip.geometry.protocols import Function, FunctionSpace, Mat, Sparse, UflExpr, UflForm, Vec
from stickslip.geometry.surfaces.faces import part_of, split_at_edges, with_sides_beside
from stickslip.geometry.surfaces.surface import SECTOR, Surface, gather_surface, of_sectors, own_nodes
from stickslip.solvers.contact.pairing import pair_up, with_halves, with_images
from stickslip.solvers.contact.rows import ContactRows
from stickslip.solvers.contact.skins import NEAR
from stickslip.solvers.effects import active
from stickslip.solvers.fem.constraints import Constraints
from stickslip.solvers.fem.forms import WeakForms
from stickslip.solvers.fem.mean_dilatation import MeanDilatation
from stickslip.solvers.fem.rigid_modes import RigidModes
from stickslip.solvers.fem.springs import GroundSprings, Links, vertex_at
from stickslip.solvers.fem.supports import find_constraints
from stickslip.solvers.fem.terms import InitialStrain
from stickslip.solvers.parallel.counters import Counters
from stickslip.solvers.parallel.released import watch
from stickslip.solvers.scene.problem import BESIDE, Problem
from stickslip.solvers.scene.timeline import Course, Place
from stickslip.solvers.system.applied_loads import AppliedLoads, InitialStrains
from stickslip.solvers.system.contact_interface import ContactInterface, Obstacles
from stickslip.solvers.system.stiffness import AveragedStiffness, Products, Stiffness


@dataclass(frozen=True)
class System:
    """The problem on its mesh, assembled: all data that do not depend on the tractions."""

    problem: Problem
    mesh: Mesh
    space: FunctionSpace
    nodes: Nodes
    weak: WeakForms
    counters: Counters
    constraints: Constraints
    contacts: tuple[ContactRows, ...]
    assembled: Callable[[], Stiffness | AveragedStiffness]  # assembles K at the first call
    T: Mat  # (all, all), columns of eliminated entries are zero
    loads: AppliedLoads
    initial: InitialStrains
    dilatation: MeanDilatation  # of nearly incompressible bodies
    ground: GroundSprings  # what springs to the ground exert

    @property
    def course(self) -> Course:
        """The values in time."""
        return self.constraints.course

    @property
    def K(self) -> Products:
        """Stiffness of all displacements, PETSc [N/m], for products; assembled at the first access."""
        return self.assembled().whole

    @property
    def K_B(self) -> Mat:
        """Stiffness of the free displacements, T^T K T [N/m]; see `Stiffness`."""
        return self.assembled().free

    def vector(self) -> Vec:
        """A PETSc vector of zeros over all displacements."""
        return self.T.createVecLeft()

    def load(self, time: float) -> Vec:
        """External forces at a time [s], without reactions and initial strains, over all displacements [N]."""
        total = self.vector()
        self.loads.add_to(total, self.course, time)
        if self.prestress is not None:
            total.axpy(1.0, self.prestress)
        return total

    @cached_property
    def prestress(self) -> Vec | None:
        """B^T p of initial tractions [N], which the stress of the undeformed bodies balances; None: there are none."""
        if all(pair.contact.initial is None for pair in self.problem.pairs.values()):
            return None
        pairs = [c.initial for c in self.contacts]
        return self.interface.forces([p for p, _ in pairs], [t for _, t in pairs])

    def prescribed(self, time: float) -> Vec:
        """u_s(t) over all displacements [m]: zero at nodes that are not prescribed; collective.

        If the supports prescribe a rigid motion, u_s is that rigid motion at all nodes.
        """
        total, motion = self.vector(), self.rigid_motion(time)
        if motion is None:
            at = self.constraints.prescribed_nodes - self.nodes.offset
            total.array.reshape(-1, self.mesh.dim)[at] = self.constraints.prescribed(time)
        else:
            nodes, own = self.nodes, slice(self.nodes.owned)
            total.array[:] = self.lifting.displacement(motion, nodes.points[own], nodes.part[own]).ravel()
        return total

    def free_part(self, u: Vec, time: float) -> Vec:
        """q with u = T q + u_s(t) at time t [s] over the free displacements; the prescribed part of u is ignored."""
        q = self.T.createVecRight()
        self.T.multTranspose(u - self.prescribed(time), q)
        return q / self._squares

    @cached_property
    def _squares(self) -> Vec:
        """Squared norms of the columns of T, which are orthogonal to each other; 1 of eliminated entries."""
        found = self.T.transposeMatMult(self.T).getDiagonal()
        found.array[found.array_r == 0] = 1.0
        return found

    def pull(self, time: float, load: Vec, u_s: Vec) -> Vec:
        """T^T (load + load of initial strains - K u_s) over the free displacements [N].

        If u_s is a rigid motion, K u_s is zero and left out, so that no rounding remains.
        """
        found = self.T.createVecRight()
        total = self.initial.added(load, self.initial.values(self.course, time))
        resisted = self.rigid_motion(time) is None
        self.T.multTranspose(total - self.K * u_s if resisted else total, found)
        return found

    def rigid_motion(self, time: float) -> Array | None:
        """Coefficients of a rigid motion that is all that is prescribed and that nothing resists, or None; collective.

        See `RigidModes.followed`; where an effect adds other stiffness than springs, every motion is resisted.
        """
        unknown = any(effect.other_stiffness(self.problem) for effect in active(self.problem))
        return None if unknown else self.lifting.followed(time)

    @cached_property
    def lifting(self) -> RigidModes:
        """Rigid modes of the bodies, and the rigid motion that supports prescribe."""
        return RigidModes(self.constraints, self.mesh.joints, *self.box)

    @cached_property
    def interface(self) -> ContactInterface:
        """Contact dofs, and displacement and forces at the contacts."""
        return ContactInterface(
            mesh=self.mesh,
            constraints=self.constraints,
            contacts=self.contacts,
            motions=self.lifting,
            obstacles=self.obstacles,
            T=self.T,
            sliding=any(pair.contact.sliding or pair.skins for pair in self.problem.pairs.values()),
        )

    @cached_property
    def obstacles(self) -> Obstacles:
        """Motion of the rigid obstacles."""
        return Obstacles(self.problem, self.course)

    def searched(self, moved: Mapping[str, Array]) -> System:
        """The same system with the sliding contacts searched again on the deformed surfaces.

        Args:
            moved: displacement (n_all, d) [m] of the nodes of each sliding contact, by contact; of pairs that are found
                also which nodes are near, besides those that are near here.
        """
        known = {c.name: c for c in self.contacts}
        lists = {f"{c.name}{NEAR}": c.near for c in self.contacts if c.near is not None}
        moved = {**moved, **{key: np.maximum(near, moved.get(key, 0.0)) for key, near in lists.items()}}
        last = sorted(self.problem.pairs.items(), key=lambda each: each[0] in moved)  # others have parts of their sides
        sides = {pair.surfaces[0]: known[name].surface for name, pair in last}
        masters = {pair.surfaces[1]: known[name].master for name, pair in last}
        sides |= {name: side for name, side in masters.items() if name is not None and side is not None}
        rows = pair_up(self.problem, sides, self.constraints, moved)
        self.counters.searches += sum(1 for c in rows if c.master)
        tied = {name for name, pair in self.problem.pairs.items() if pair.contact.normal.ties}
        fresh = tuple(c if c.name in moved and c.name not in tied else known[c.name] for c in rows)
        return replace(
            self, contacts=tuple(replace(c, surface=known[c.name].surface, master=known[c.name].master) for c in fresh)
        )

    def reactions(self, residual: Vec) -> dict[str, tuple[Array, Array]]:
        """Force (d,) [N] and moment about the origin [N m] that each support exerts; collective.

        Args:
            residual: see `State` [N].
        """
        return self.constraints.reactions(residual.array_r.reshape(-1, self.mesh.dim))

    @cached_property
    def held_places(self) -> dict[str, tuple[Ints, Array]]:
        """Own local nodes (n,) that supports and springs to the ground hold, and their weights, by name; collective."""
        held = {name: each.boundary or np.array(each.point) for name, each in self.problem.supports.items()}
        sprung = {each.key: each.boundary for each in self.problem.springs}
        return {key: self._held_at(key, place) for key, place in (held | sprung).items()}

    def _held_at(self, key: str, place: str | Array) -> tuple[Ints, Array]:
        if isinstance(place, str):
            side = own_nodes(self.mesh, self.space, self.nodes, place)
            return side.local, side.weights
        found = vertex_at(self.mesh, self.nodes, place, key)[0] - self.nodes.offset
        found = found[(found >= 0) & (found < self.nodes.owned)]
        return found, np.ones(len(found))

    @cached_property
    def box(self) -> Array:
        """Lower and upper corner of the bodies' bounding box (2, d) [m]."""
        return self.mesh.box()

    @cached_property
    def extent(self) -> float:
        """L, the largest side of the bodies' bounding box [m]."""
        return float(np.max(self.box[1] - self.box[0]))


def contact_rows(
    problem: Problem, mesh: Mesh, space: FunctionSpace, nodes: Nodes, constraints: Constraints
) -> tuple[ContactRows, ...]:
    """Rows of all contacts of the problem, their surfaces gathered on every rank; collective."""
    sides = {name: gather_surface(mesh, space, nodes, name) for name in problem.request.contact_sides}
    faces = {name: split_at_edges(side, mesh.edges.get(name)) for name, side in sides.items()}
    found = with_halves(problem, with_sides_beside(faces))
    if problem.request.turns:
        found = {name: with_images(side, constraints) for name, side in found.items()}
        for two in filter(None, (pair.surfaces[1] for pair in problem.pairs.values())):
            problem.request.refuse_other_sectors()
            found[two] = of_sectors(found[two.removesuffix(BESIDE)], problem.request.sectors)
    return pair_up(problem, found, constraints, {})


def displacement_space(mesh: Mesh) -> FunctionSpace:
    """Vector-valued Lagrange elements of the degree of the mesh."""
    return dx.vector_space(mesh.domain, mesh.degree)


def inner_forces(problem: Problem, weak: WeakForms, u: UflExpr | None = None) -> UflForm:
    """a(u, v) of the bodies, with the stiffness of effects; u: displacement Function, None: the trial function."""
    form = weak.elasticity(u)
    for effect in active(problem):
        form = sum(effect.stiffness(problem, weak, weak.u if u is None else u), start=form)
    return form


def whole_stiffness(problem: Problem, weak: WeakForms, links: Links, dilatation: MeanDilatation | None = None) -> Mat:
    """K of the bodies, of effects and of links, PETSc [N/m]; without `dilatation` only of averaged bodies' shear.

    Collective.
    """
    K = dx.assemble_matrix(weak.compile(inner_forces(problem, weak)))
    if dilatation is not None:
        K = dilatation.add_to(K)
    if links:
        K.axpy(1.0, links.matrix(K), PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return K


def _assembled(
    problem: Problem, weak: WeakForms, constraints: Constraints, dilatation: MeanDilatation, T: Mat
) -> Stiffness | AveragedStiffness:
    """The stiffness; collective."""
    # of bodies that float rounding sees to it that forces are in balance; in 2D factors take the time, not products
    rounded = constraints.dim == 2 or dilatation or problem.rigid_modes.shape[1]

    def matrix(*averages: MeanDilatation) -> Stiffness:
        K = whole_stiffness(problem, weak, constraints.links, *averages)
        return Stiffness.of(K, T, constraints, clean=not rounded)

    return AveragedStiffness(matrix(), dilatation, T, lambda: matrix(dilatation)) if dilatation else matrix()


def applied_loads(problem: Problem, weak: WeakForms, constraints: Constraints, like: Vec) -> AppliedLoads:
    """The loads of the scene, of all active effects and of remote points; collective."""
    of_effects = (term for effect in active(problem) for term in effect.loads(problem, weak))
    return AppliedLoads(weak, [*weak.loads(), *of_effects], constraints.remote.loads(like))


def _initial_strains(
    problem: Problem, weak: WeakForms, dilatation: MeanDilatation, links: Links, like: Vec
) -> InitialStrains:
    """Assemble the initial strains of all active effects, and of links; collective.

    Raises:
        SceneError: an expression has no finite value, or a body nothing that could shrink.
    """
    strains = tuple(strain for effect in active(problem) for strain in effect.initial_strains(problem))
    rests, means = links.at_rest, [dilatation.of_strain(strain) for strain in strains]
    coupling = block_diag(np.zeros((len(strains), len(strains))), rests * links.stiffness @ rests.T)
    for i, one in enumerate(strains):
        for j, other in enumerate(strains):
            if one.body == other.body:
                pair = (one, other, means[i]) if means[i] is not None else (other, one, means[j])
                coupling[i, j] = weak.initial_energy(*pair)
        # stiffness of what shrinks, relative to E [m]: below it is rounding
        if one.shrunk is not None and coupling[i, i] <= 1e-20 * problem.bodies[one.body].modulus:
            assert isinstance(one.drive, Place)
            key = f"{one.drive.table}.{one.drive.name}.shank"
            raise SceneError(f"{key}: no part of {one.body} lies between the two planes")
    shrinking = {i: weak.shrinking(strain) for i, strain in enumerate(strains) if strain.shrunk is not None}
    return InitialStrains(
        strains=strains,
        by_cell={i: weak.strain_by_cell(u)() for i, u in shrinking.items()},
        means={i: dilatation.in_cells(mean) for i, mean in enumerate(means) if mean is not None},
        rests=links.rests,
        forces=(
            *(_initial_forces(weak, strain, mean) for strain, mean in zip(strains, means, strict=True)),
            *(links.forces(like, links.stiffness * rest) for rest in rests),
        ),
        coupling=coupling,
    )


def _initial_forces(weak: WeakForms, strain: InitialStrain, mean: Function | None) -> Vec:
    """∫ C strain : eps(v) dx at value 1 [N]; collective.

    Raises:
        SceneError: an expression has no finite value.
    """
    found = weak.load_of(strain, mean)
    if not np.isfinite(found.norm()):
        raise SceneError(f"{strain.field}: the expression has no finite value somewhere in the body")
    return found


def assemble(problem: Problem, mesh: Mesh, counters: Counters, smooth: int | None = None) -> System:
    """Build the system; collective.

    Args:
        smooth: see `WeakForms`; None: as usual.

    Raises:
        SceneError: supports prescribe everything, or contradict each other.
    """
    watch(mesh)
    space = displacement_space(mesh)
    nodes = Nodes.of(mesh, space)
    denser = {} if smooth is None else {"smooth": smooth}
    weak = WeakForms(problem, mesh, space, counters, **denser)
    constraints = find_constraints(problem, mesh, space, nodes)
    if constraints.free_total == 0:
        raise SceneError("supports: prescribe every displacement of the mesh; nothing is left to solve")
    for time in problem.timeline.times:
        constraints.prescribed(time)  # refuses supports that contradict each other, before any solve
    contacts = contact_rows(problem, mesh, space, nodes, constraints)
    dilatation = MeanDilatation(weak)
    counters.searches += sum(1 for c in contacts if c.master)
    T = constraints.transformation()
    return System(
        problem=problem,
        mesh=mesh,
        space=space,
        nodes=nodes,
        weak=weak,
        counters=counters,
        constraints=constraints,
        contacts=contacts,
        assembled=cache(lambda: _assembled(problem, weak, constraints, dilatation, T)),
        dilatation=dilatation,
        ground=GroundSprings.of(weak),
        T=T,
        loads=applied_loads(problem, weak, constraints, T.createVecLeft()),
        initial=_initial_strains(problem, weak, dilatation, constraints.links, T.createVecLeft()),
    )


def contact_sides(system: System) -> Iterator[tuple[str, Surface, Sparse]]:
    """Name, surface, and the sparse matrix (n d, c) from contact dofs to the displacement of the side's nodes."""
    seen = set[tuple[str, bytes]]()  # contacts may have different parts of a side
    for rows in system.contacts:
        pair, trace, first = system.problem.pairs[rows.name], system.interface.trace(rows), 0
        for name, side in ((pair.slave, rows.surface), (pair.master, rows.master)):
            if side is not None and name is not None:
                last, key = first + side.dim * len(side.nodes), (name, side.nodes.tobytes())
                if key not in seen:
                    if pair.cyclic:
                        side = part_of(side, (side.nodes[side.facets] < SECTOR).all(axis=1))
                    yield name, side, trace[first : first + side.dim * len(side.nodes)]
                seen.add(key)
                first = last
