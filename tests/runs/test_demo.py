"""The demo in plain gmsh, UFL, dolfinx and PETSc has the answer of `stickslip` on the same mesh."""

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib import image
from numpy.testing import assert_allclose
from scipy.spatial import cKDTree

import stickslip
from stickslip.geometry.arrays import Array
from stickslip.workflows.demos import uzawa_block as demo

COARSE = 4  # edges a metre
ITERATED = 1e-9  # relative; both iterations end at about 1e-11
Answer = dict[str, Any]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("demo")


@pytest.fixture(scope="module")
def answer(folder: Path) -> Answer:
    return demo.main(COARSE, folder)


def solved(folder: Path, method: str, mu: float) -> tuple[stickslip.StepResult, stickslip.MeshData]:
    """The last step of the demo's scene on the mesh that the demo has written, and this mesh."""
    simulation = stickslip.prepare(
        stickslip.Scene(
            model="plane strain",
            geometry=stickslip.UserFile(file=str(folder / "block.msh")),
            bodies={"block": stickslip.Material(E=demo.E, nu=demo.NU)},
            obstacles={"plane": stickslip.Plane(point=(0.0, 0.0), normal=(0.0, 1.0))},
            contacts={
                "base": stickslip.Contact(
                    surface="block.bottom",
                    against="plane",
                    normal=stickslip.Compliance(c_n=demo.C_N, m_n=demo.M_N),
                    friction=stickslip.Coulomb(mu=mu),
                )
            },
            supports={
                "top": stickslip.Support(
                    boundary="block.top", displacement={"x": ((1, 0), (2, 0.05)), "y": ((1, -0.1),)}
                )
            },
            steps=stickslip.Steps(end=2.0, count=2),
            solver=stickslip.Solver(method=method, tolerance=1e-11),
        )
    )
    *_, last = simulation.steps()
    return last, simulation.data


def at(field: Any, points: Array) -> Array:
    """Values of a function of order 1 at nodes (n, d) of its mesh."""
    space = field.function_space
    distance, found = cKDTree(space.tabulate_dof_coordinates()[:, :2]).query(points)
    assert max(distance) < 1e-12
    return np.asarray(field.x.array.reshape(-1, space.dofmap.index_map_bs)[found])


@pytest.mark.parametrize("method", ["condensed-newton", "block-uzawa"])
def test_demo_agrees_with_stickslip_in_forces_displacement_lambda(answer: Answer, folder: Path, method: str) -> None:
    step, data = solved(folder, method, mu=0.3)
    base = step.contacts["base"]
    tangential, normal = answer["force"]
    assert_allclose(normal, base.normal_force, rtol=ITERATED)
    assert_allclose(tangential, base.force[0], rtol=ITERATED)
    assert_allclose(at(answer["u"], data.points), step.displacement, rtol=0, atol=ITERATED * 0.1)  # the top: 0.1 m
    lam = at(answer["lam"], data.surfaces["base"][0])[:, 0]
    assert_allclose(lam, base.lam[:, 0], rtol=0, atol=1e-7)  # a traction's error over s, which is about 0.01 Pa
    assert 0 < base.stick_area < 4.0  # both kinds of nodes are there
    assert max(abs(lam)) <= 1 + 1e-15


def test_without_friction_the_plane_resists_no_sideways_motion(answer: Answer, tmp_path: Path) -> None:
    smooth = demo.main(COARSE, tmp_path, mu=0.0)
    assert abs(smooth["force"][0]) < 1e-12
    assert answer["force"][0] < -0.02  # with friction
    assert max(abs(smooth["u"].x.array - answer["u"].x.array)) > 0.01
    assert not smooth["lam"].x.array.any()  # (2.2): no multiplier where s = 0
    step, _ = solved(tmp_path, "condensed-newton", mu=0.0)
    assert_allclose(smooth["force"][1], step.contacts["base"].normal_force, rtol=ITERATED)


def test_regularised_friction_is_near_but_not_the_same(answer: Answer) -> None:
    assert_allclose(answer["regularised"], answer["force"], rtol=0.02)  # it creeps, and has its bound at the nodes
    assert max(abs(answer["regularised"] / answer["force"] - 1)) > 1e-5


def test_blocks_are_those_of_a_saddle_point(answer: Answer) -> None:
    nest = answer["blocks"]
    assert nest.getType() == "nest"
    tangent, B_T, B = (nest.getNestSubMatrix(*place) for place in ((0, 0), (0, 1), (1, 0)))
    t = B.createVecLeft()
    t.array = np.sin(np.arange(t.size))  # some traction
    u = tangent.createVecRight()
    u.array = np.cos(np.arange(u.size))  # some displacement
    assert_allclose((B * u).dot(t), u.dot(B_T * t), rtol=1e-12)  # <B u, t> = <u, B^T t>
    assert_allclose(B.getRowSum().sum(), 4.0, rtol=1e-12)  # of the multipliers of the bottom, 4 m long
    assert tangent.isSymmetric(1e-12)


def test_files_are_there_and_the_picture_is_not_blank(answer: Answer, folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == {"block.msh", "block.xdmf", "block.h5", "block.png"}
    series = (folder / "block.xdmf").read_text(encoding="utf-8")
    assert all(f'Name="{name}"' in series for name in ("displacement", "lambda"))
    assert (folder / "block.h5").stat().st_size > 1000
    drawn = image.imread(folder / "block.png")
    assert len({tuple(pixel) for row in drawn[::5] for pixel in row[::5]}) > 50  # a blank sheet has one colour


def test_demo_is_short_enough_to_be_read() -> None:
    assert len(Path(inspect.getfile(demo)).read_text(encoding="utf-8").splitlines()) <= 150
