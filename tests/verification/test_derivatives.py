"""Derivatives by numbers of a scene, against those of closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from stickslip import Scene, StepResult
from stickslip.geometry.arrays import Array
from stickslip.solvers.scene.parameters import Sensitivity
from stickslip.workflows.lab.verification.cases import cattaneo
from stickslip.workflows.lab.verification.prepared import solved
from stickslip.workflows.scene_file.read import read, with_keys


def logarithmic(scene: Scene, keys: tuple[str, ...], *names: str) -> Array:
    """Derivatives d ln number / d ln key of the last step (names, keys)."""
    *_, step = solved(replace(scene, sensitivity=Sensitivity(parameters=keys)))[1]
    return np.array([[relative(step, scene, name, key) for key in keys] for name in names])


def relative(step: StepResult, scene: Scene, name: str, key: str) -> float:
    """One of them; of an area with its edge between nodes, over the area by nodes."""
    slope, (contact,) = step.sensitivity[name][key].value, step.contacts.values()
    assert slope is not None
    return float(slope) * scene.parameters()[key] / float(getattr(contact, name.rpartition(".")[2]))


def test_cattaneos_stick_width_falls_with_shear_and_grows_with_friction() -> None:
    mu, aside = "contacts.face.friction.mu", "supports.top.displacement.x"
    scene = cattaneo.scene(cattaneo.Two(), [(0.0, -cattaneo.DOWN), (cattaneo.ASIDE, -cattaneo.DOWN)])
    *_, step = solved(replace(scene, sensitivity=Sensitivity(parameters=(mu, aside))))[1]
    c = {key: step.sensitivity["contacts.face.stick_area"][key].value / 2 for key in (mu, aside)}
    Q = {key: abs(step.sensitivity["contacts.face.tangential_force"][key].value) for key in (mu, aside)}
    by_Q = c[aside] / Q[aside]
    found = np.array([c[mu] - by_Q * Q[mu], by_Q])  # mu at the same Q: what the motion adds goes
    face = step.contacts["face"]
    P, shear = face.normal_force, face.tangential_force
    exact = cattaneo.cattaneo(P, shear, cattaneo.R / 2, cattaneo.Two().E_star, cattaneo.MU)
    part = exact.pressed.a**2 / (2 * exact.c)  # c^2 = a^2 (1 - Q / (mu P))
    true = part * np.array([shear / (cattaneo.MU**2 * P), -1 / (cattaneo.MU * P)])
    assert true == pytest.approx([1.0924, -0.23336], rel=0.03)  # at P = 10, Q = .93622: REFERENCES
    assert found == pytest.approx(true, rel=0.12)  # of cells of a / 12, wherever in one the edge lies


def test_hertz_has_his_exponents() -> None:
    keys = depth, radius, centre, E = (
        "obstacles.plane.displacement.y",
        "obstacles.plane.radius",
        "obstacles.plane.center.y",
        "bodies.disc.E",
    )
    size = {"geometry.contact_mesh_size": 0.008, "geometry.contact_radius": 0.104}  # a = .08
    ball = {"shape": "sphere", "center": [0.0, -8.0], "radius": 8.0, "displacement": {"y": 0.08**2 / 4}}
    scene = with_keys(read("sphere"), size | {"obstacles.plane": ball})  # rigid, as large as the elastic one
    found = logarithmic(scene, keys, "contacts.pole.normal_force", "contacts.pole.contact_area")
    grown = found[:, keys.index(radius)] + found[:, keys.index(centre)]  # its pole stays: this is half of that by R
    assert found[0, keys.index(depth)] == pytest.approx(1.5, rel=0.02)  # bodies are 100 times as large
    assert 2 * grown[0] == pytest.approx(0.5, rel=0.05)
    assert [found[1, keys.index(depth)], 2 * grown[1]] == pytest.approx([1.0, 1.0], rel=0.15)  # of cells of a / 10
    assert found[:, keys.index(E)] == pytest.approx([1.0, 0.0], abs=1e-6)
