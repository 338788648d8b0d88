"""Calibration of numbers of a scene by a measured history, and what data do not tell."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from shared.problems import on_floor, scene_of
from stickslip import Scene, SceneError, fit, prepare
from stickslip.solvers.results.step_result import values
from stickslip.workflows.commands.fit import fit as command
from stickslip.workflows.formats.files import read_json
from stickslip.workflows.scene_file.read import from_dict, read, with_keys
from stickslip.workflows.sweep.fit import Columns, read_data

FORCE = "support.top.force.x"  # with its sign: lengths of forces fold where motions turn
MU, K_T, C_N = "contacts.base.friction.mu", "contacts.base.friction.k_T", "contacts.base.normal.c_n"


def drawn() -> Scene:
    """A block on a floor whose asperities bend, drawn until a part of it slips, and back."""
    top = {"x": [[0, 0], [1, 0], [2, 0.3], [3, 0.0]], "y": [[0, 0], [1, -0.1]]}
    friction = {"law": "coulomb", "mu": 0.3, "k_T": 1.0}
    return scene_of(2, base={"friction": friction}, top=top, steps={"end": 3.0, "count": 12})


def pressed() -> Scene:
    """A block under pressure on an elastic foundation."""
    tables = on_floor(2, {"mesh_size": 0.5}, {}, {"normal": {"law": "compliance", "c_n": 9.0, "m_n": 1.0}})
    sides = {"middle": {"boundary": "block.left", "displacement": {"x": 0.0}}}
    return from_dict(tables | {"loads": {"top": {"boundary": "block.top", "pressure": 0.1}}, "supports": sides})


def history(scene: Scene, *names: str) -> dict[str, np.ndarray]:
    """Numbers of a scene's steps, as if they were measured."""
    steps = [*prepare(replace(scene, output=replace(scene.output, error=False))).steps()]
    found = {name: np.array([values(step)[name] for step in steps]) for name in names}
    return {"time": np.array([step.time for step in steps])} | found


def quiet(line: str) -> None:
    """Say nothing."""


def test_a_loop_tells_friction_and_the_stiffness_of_asperities() -> None:
    data = history(with_keys(drawn(), {MU: 0.36, K_T: 0.7}), FORCE)
    found = fit(drawn(), data, (MU, K_T), tell=quiet)
    assert_allclose([found.values[MU], found.values[K_T]], [0.36, 0.7], rtol=1e-4)
    assert not found.not_told
    assert found.runs < 15
    assert found.scene.parameters()[MU] == found.values[MU]


def test_noise_is_in_the_covariance() -> None:
    rng, true = np.random.default_rng(1), 0.36
    data = history(with_keys(drawn(), {MU: true}), FORCE)
    size = 0.02 * np.abs(data[FORCE]).max()
    noisy = data | {FORCE: data[FORCE] + size * rng.standard_normal(12)}
    found = fit(drawn(), noisy, (MU,), tell=quiet)
    assert abs(found.values[MU] - true) < 3 * found.deviations[MU] < 0.1 * true
    assert found.remainder[FORCE] == pytest.approx(size, rel=0.6)


def test_what_data_do_not_tell_is_said() -> None:
    scene = pressed()
    data = history(with_keys(scene, {C_N: 12.0}), "base.normal_force", "base.max_penetration")
    held: Columns = {name: data[name] for name in ("time", "base.normal_force")}
    assert fit(scene, held, (C_N,), tell=quiet).not_told == (C_N,)  # the force is that of the load
    found = fit(scene, data, (C_N,), tell=quiet)
    assert not found.not_told
    assert found.values[C_N] == pytest.approx(12.0, rel=1e-4)


def test_the_command_leaves_covariance_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["geometry.mesh_size=0.5", "geometry.contact_mesh_size=0.5"]
    data = history(read("block", [*words, f"{MU}=0.25"]), "base.tangential_force")
    table, folder = tmp_path / "data.csv", tmp_path / "fit"
    rows = zip(*data.values(), strict=True)
    table.write_text("time, base.tangential_force\n" + "".join(f"{time}, {value}\n" for time, value in rows))
    command("block", table, MU, folder, words)
    assert read_json(folder / "fit.json")["values"][MU] == pytest.approx(0.25, rel=1e-4)
    assert (folder / "fit.png").stat().st_size > 10_000
    assert MU in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a,b\n1,2\n", "expected a column time"),
        ("time,x\n1,y\n", "table of numbers"),
        ("time,x\n1,2\n3\n", "table of numbers"),
        (f'time,x\n1,"{"1" * 200_000}"\n', "field larger than field limit"),
        ("time,x\n", "expected numbers"),
        ("time,x\n1\n", "1 columns: expected one for each of 2 names"),
        ("time,x\n1,2,3\n", "3 columns: expected one for each of 2 names"),
        ("time,x,x\n1,2,3\n", "expected each name once"),
    ],
)
def test_what_is_no_table_of_data_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "data.csv"
    path.write_text(text)
    with pytest.raises(SceneError, match=words):
        read_data(path)


def test_a_table_of_a_spreadsheet_is_read(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes("\ufeff time , x\r\n1, 2\r\n".encode())
    assert read_data(tmp_path / "data.csv") == {"time": 1.0, "x": 2.0}


@pytest.mark.parametrize(
    ("data", "keys", "words"),
    [
        ({"time": np.ones(3), FORCE: np.array([1.0, np.nan, 1.0])}, (MU,), "expected 3 finite numbers"),
        ({"time": np.ones(3), FORCE: np.ones(2)}, (MU,), "expected 3 finite numbers"),
        ({"time": np.array([0.0, np.inf]), FORCE: np.ones(2)}, (MU,), "expected 2 finite numbers"),
        ({"time": np.array([1.0, 3.5]), FORCE: np.ones(2)}, (MU,), "fit = 3.5: times lie from 0 to 3"),
        ({"time": np.array([-1.0, 2.0]), FORCE: np.ones(2)}, (MU,), "times lie from 0 to 3"),
        ({FORCE: np.ones(2)}, (MU,), "expected time"),
        ({"time": np.ones(2), FORCE: np.ones(2)}, (MU, MU), "each key once"),
        ({"time": np.ones(2), FORCE: np.ones(2)}, (), "each key once"),
    ],
)
def test_columns_that_cannot_be_fitted_are_refused_before_a_run(
    data: dict[str, np.ndarray], keys: tuple[str, ...], words: str
) -> None:
    with pytest.raises(SceneError, match=words):
        fit(drawn(), data, keys, tell=pytest.fail)


def test_data_that_no_step_has_are_refused() -> None:
    with pytest.raises(SceneError, match="no such number"):
        fit(drawn(), {"time": np.ones(3), "base.force": np.ones(3)}, (MU,), tell=quiet)
    with pytest.raises(SceneError, match="fewer than the 2 numbers"):
        fit(drawn(), {"time": np.ones(1), "base.normal_force": np.ones(1)}, (MU, K_T), tell=quiet)
