"""A block pressed onto a compliant plane and pushed sideways: the method of Pop (1999) in one program.

gmsh makes the geometry. UFL expresses the works a, j_n, b, and beside b the regularised form of friction. dolfinx
assembles the blocks [[F', Bᵀ], [B, −C]]. Uzawa's loop, in Python, iterates on the tangential multiplier λ, |λ| <= 1.
XDMF for ParaView; a picture by pyvista. Comments name equations of Pop. `stickslip run` finds the same answer.
"""

from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pyvista
import ufl
from dolfinx import fem, io
from mpi4py import MPI
from petsc4py import PETSc

from stickslip.geometry import dolfinx_versions as dx  # calls that differ between the versions of dolfinx

E, NU, C_N, M_N, G = 1.0, 0.3, 20.0, 2, 0.0  # [Pa], [-], [Pa/m²], [-], [m]
BOTTOM, TOP = 1, 3  # tags of sides
NODES = {"quadrature_rule": "custom", "quadrature_points": [[0.0], [1.0]], "quadrature_weights": [0.5, 0.5]}


def make_mesh(n: int, folder: Path) -> tuple[Any, Any]:
    """The block [0, 4] x [0, 2] in triangles with edges 1/n, and the tags of its facets."""
    gmsh.initialize(["", "-v", "0"])
    gmsh.model.occ.addRectangle(0, 0, 0, 4, 2)  # its curves are numbered 1 to 4 from the bottom
    gmsh.model.occ.synchronize()
    gmsh.model.mesh.setSize(gmsh.model.getEntities(0), 1 / n)
    for dim, tag, name in ((2, 1, "block"), (1, BOTTOM, "block.bottom"), (1, TOP, "block.top")):
        gmsh.model.setPhysicalName(dim, gmsh.model.addPhysicalGroup(dim, [tag], tag), name)
    gmsh.model.mesh.generate(2)
    gmsh.write(str(folder / "block.msh"))
    domain, _, facets = dx.model_to_mesh(gmsh.model, MPI.COMM_WORLD, 2)
    gmsh.finalize()
    return domain, facets


class Block:
    """The works of the forces on a displacement v, with normal (0, −1): u_n = −u[1], u_T = u[0]; and their matrices."""

    def __init__(self, domain: Any, facets: Any, mu: float) -> None:
        V: Any = dx.vector_space(domain, 1)
        self.V, self.Q = V, Q = V, V.sub(0).collapse()[0]  # Q: of λ and its bound s, which live at the bottom alone
        self.u, self.before, self.s, self.lam = u, before, s, lam = [fem.Function(space) for space in (V, V, Q, Q)]
        u.name, lam.name, v, eta = "displacement", "lambda", ufl.TestFunction(V), ufl.TestFunction(Q)
        on_bottom = ufl.Measure("ds", domain=domain, subdomain_data=facets, subdomain_id=BOTTOM)
        gauss, nodes = on_bottom(degree=1 + M_N), on_bottom(metadata=NODES, degree=1)
        self.sigma = E / (1 + NU) * (ufl.sym(ufl.grad(u)) + NU / (1 - 2 * NU) * ufl.div(u) * ufl.Identity(2))
        a = ufl.inner(self.sigma, ufl.sym(ufl.grad(v))) * ufl.dx  # (2.1): a(u, v) = ∫ σ(u) : ε(v) dx
        p_n = C_N * ufl.max_value(-u[1] - G, 0) ** M_N  # c_n (u_n − g)_+^m_n
        j_n = p_n * -v[1] * gauss  # (2.1): j_n(u; v) = ∫ c_n (u_n − g)_+^m_n v_n ds, the penalty's work
        b = s * lam * v[0] * nodes  # (2.3): b(λ, v; s) = ∫ s λ · v_T ds; each node has a λ of its own
        self.width, mu, slip = *(fem.Constant(domain, c) for c in (1.0, mu)), u[0] - before[0]  # since the last step
        smooth = mu * p_n * slip / ufl.sqrt(slip**2 + self.width**2) * v[0] * nodes  # regularised: b with λ(u)
        self.exact = [*map(dx.compile_form, (a + j_n + b, ufl.derivative(a + j_n + b, u)))]  # F(u) + Bᵀ(s λ), F'
        self.smooth = [*map(dx.compile_form, (a + j_n + smooth, ufl.derivative(a + j_n + smooth, u)))]
        self.bound = dx.compile_form(mu * p_n * eta * gauss)  # ∫ s φ ds, s = μ p_n
        self.side = fem.locate_dofs_topological(Q, 1, facets.find(BOTTOM))
        self.top = fem.locate_dofs_topological(V, 1, facets.find(TOP))
        B: Any = dx.assemble_matrix(dx.compile_form(eta * ufl.TrialFunction(V)[0] * nodes))  # of b(λ, v; 1)
        self.B = B.createSubMatrix(PETSc.IS().createGeneral(self.side))
        self.B_T, self.W = self.B.copy().transpose(), self.B.getRowSum().array  # W_j = ∫ φ_j ds
        self.lu = PETSc.PC().create()
        self.lu.setType("lu")

    def newton(self, forms: Any, delta: float = 1e-13, renew: bool = True) -> Any:
        """Solve F(u) = f − Bᵀ(s λ) + δ (1.3), f = 0, or with regularised friction; returns the force on the block."""
        for _ in range(99):
            r, du = dx.assemble_vector(forms[0]), self.B.createVecRight()
            force = -r.array.reshape(-1, 2).sum(axis=0)  # a does no work on a translation
            r.array.reshape(-1, 2)[self.top] = 0
            if r.norm() < delta:
                return force
            if renew:
                K = fem.petsc.assemble_matrix(forms[1], bcs=[fem.dirichletbc(np.zeros(2), self.top, self.V)])
                K.assemble()
                self.lu.setOperators(K)
                self.blocks = PETSc.Mat().createNest([[K, self.B_T], [self.B, None]])  # (1.1), (5.3); C = 0
            self.lu.apply(r, du)
            self.u.x.array[:] -= du.array
        raise RuntimeError("Newton's method does not converge")

    def largest_eigenvalue(self) -> float:
        """λ_1 of W⁻¹ B F'⁻¹ Bᵀ by a few power iterations (5.4)."""
        u, t = self.B.createVecs()
        t.set(1.0)
        for _ in range(10):
            self.lu.apply(self.B_T * (t / t.norm()), u)
            t.array = (self.B * u).array / self.W
        return float(t.norm())

    def uzawa(self, motion: tuple[float, float]) -> tuple[Any, int]:
        """λ ← P_{|λ|<=1}(λ + α Q⁻¹ B Δu), Q = s W, 0 < α < 2/λ_1 (1.2), (5.4); s follows u: Coulomb's law."""
        self.before.x.array[:] = self.u.x.array
        self.u.x.array.reshape(-1, 2)[self.top] = motion
        self.newton(self.exact)
        alpha = 1.8 / self.largest_eigenvalue()
        for k in range(1, 50000):
            s = dx.assemble_vector(self.bound).array[self.side] / self.W
            slip = (self.B * PETSc.Vec().createWithArray(self.u.x.array - self.before.x.array)).array / self.W
            t = s * self.lam.x.array[self.side] + alpha * slip  # s times the argument of P
            lam = np.divide(t, np.maximum(s, abs(t)), where=s > 0, out=np.zeros_like(s))  # λ = 0 where s = 0 (2.2)
            change = max(abs(s * (lam - self.lam.x.array[self.side])))  # of σ_T = −s λ (2.6)
            self.s.x.array[self.side], self.lam.x.array[self.side] = s, lam
            force = self.newton(self.exact, max(0.01 * change, 1e-13), renew=False)
            if change < 1e-12:
                return force, k
        raise RuntimeError("Uzawa's iteration does not converge")

    def draw(self, file: Path) -> None:
        """The block with its shear stress, displaced 3 times as far as it is; below it λ, which is 1 or −1 in slip."""
        points = self.V.tabulate_dof_coordinates() + 3 * np.pad(self.u.x.array.reshape(-1, 2), ((0, 0), (0, 1)))
        grid = pyvista.UnstructuredGrid({pyvista.CellType.TRIANGLE: dx.cell_dofs(self.V)}, points)
        stress = dx.CellExpression(self.sigma[0, 1], dx.midpoint(self.V.mesh), self.V.mesh)(np.arange(grid.n_cells))
        plot: Any = pyvista.Plotter(off_screen=True, window_size=[1100, 1000])
        bar = {"title": "shear stress [Pa]\n", "position_x": 0.2, "position_y": 0.85, "fmt": "%.2f"}
        plot.add_mesh(grid, scalars=stress.ravel(), clim=0.02, cmap="coolwarm", show_edges=True, scalar_bar_args=bar)
        plot.camera.tight(padding=0.1, adjust_render_window=False)
        chart = pyvista.Chart2D(size=(1.0, 0.27), x_label="x [m]", y_label="lambda")
        chart.y_range = [-1.1, 1.1]
        chart.scatter(self.Q.tabulate_dof_coordinates()[self.side, 0], self.lam.x.array[self.side], size=7)
        plot.add_chart(chart)
        plot.screenshot(file)


def main(n: int, folder: Path, mu: float = 0.3) -> dict[str, Any]:
    """Solve with edges 1/n, on one process; block.msh, block.xdmf and block.png go into the folder."""
    block = Block(*make_mesh(n, folder), mu)
    with io.XDMFFile(MPI.COMM_WORLD, str(folder / "block.xdmf"), "w") as file:
        file.write_mesh(block.V.mesh)
        for time, motion in ((1.0, (0.0, -0.1)), (2.0, (0.05, -0.1))):  # [s], displacement of the top [m]
            force, k = block.uzawa(motion)
            print(f"t = {time} s: force on the block {force} N/m, {k} iterations")
            file.write_function(block.u, time)
            file.write_function(block.lam, time)
    with pyvista.vtk_verbosity("off"):  # without a display VTK complains before it draws
        block.draw(folder / "block.png")
    found = {"force": force, "u": block.u.copy(), "lam": block.lam, "blocks": block.blocks}
    for block.width.value in 0.1 / 2 ** np.arange(10):
        found["regularised"] = block.newton(block.smooth)
    return found


if __name__ == "__main__":
    print("force by regularised friction", main(12, Path())["regularised"], "N/m")
