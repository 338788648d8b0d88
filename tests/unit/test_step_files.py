"""Step files read back to the same bits, and say so when they are damaged."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from shared.disks import make_full
from shared.synthetic import job_of, mesh_of, padded, result_of
from stickslip.geometry.errors import MachineError
from stickslip.workflows.formats.hdf5 import checksum
from stickslip.workflows.formats.steps import read_step, write_step
from stickslip.workflows.writers.xdmf import FieldFiles


@pytest.mark.parametrize("shape", ["triangle", "hexahedron"])
def test_a_step_reads_back_to_the_same_bits(tmp_path: Path, shape: str) -> None:
    mesh = mesh_of(shape)
    result = result_of(mesh)
    path = write_step(tmp_path, 12, result)
    assert path == tmp_path / "steps" / "000012.h5"
    stored = read_step(path)
    assert (stored.index, stored.time, stored.p_ref, stored.u_ref) == (12, result.time, result.p_ref, result.u_ref)
    assert_array_equal(stored.displacement, padded(result.displacement))
    for name in ("stress", "von_mises", "p", "w", "reference", "driven"):
        assert_array_equal(getattr(stored, name), getattr(result, name))
    contact, found = result.contacts["base"], stored.contacts["base"]
    for name in ("weight", "gap", "pressure", "status"):
        assert_array_equal(getattr(found, name), getattr(contact, name))
    for name in ("traction", "slip", "slip_increment", "lam"):
        assert_array_equal(getattr(found, name), padded(getattr(contact, name)))
    assert found.status.dtype == np.int8
    assert sorted(p.name for p in path.parent.iterdir()) == ["000012.h5"]


def test_a_step_without_its_fields_keeps_all_else_and_none_of_their_memory() -> None:
    result = result_of(mesh_of("hexahedron"))
    left = result.without_fields()
    for name in vars(result):
        if name in ("displacement", "stress", "stress_error"):
            assert getattr(left, name).size == 0
            assert getattr(left, name).base is None  # no view of the whole
        else:
            assert getattr(left, name) is getattr(result, name)


def test_the_checksum_can_be_recomputed_by_others(tmp_path: Path) -> None:
    path = write_step(tmp_path, 3, result_of(mesh_of("triangle")))
    arrays: dict[str, Any] = {}
    with h5py.File(path, "r") as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        assert file.attrs["checksum"] == checksum(
            arrays, {name: file.attrs[name].item() for name in ("index", "time", "p_ref", "u_ref")}
        )
        assert sorted(file) == [
            "checkpoint",
            "contacts",
            "displacement",
            "state",
            "stress",
            "stress_error",
            "von_mises",
        ]


def test_every_flipped_byte_is_refused(tmp_path: Path) -> None:
    # also in HDF5's own tables: given such a file, the HDF5 library has been seen to loop for ever
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    whole = path.read_bytes()
    for place in range(0, len(whole), 7):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with pytest.raises(MachineError, match=r"000001\.h5: damaged"):
            read_step(path)


def test_a_flipped_bit_in_the_numbers_is_refused(tmp_path: Path) -> None:
    result = result_of(mesh_of("triangle"))
    path = write_step(tmp_path, 1, result)
    whole = path.read_bytes()
    place = whole.index(result.p.tobytes()) + 6
    path.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(
        MachineError, match=r"000001\.h5: damaged or cut short: its content does not match its checksum"
    ):
        read_step(path)


@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.999])
def test_a_step_cut_short_is_refused(tmp_path: Path, part: float) -> None:
    path = write_step(tmp_path, 1, result_of(mesh_of("triangle")))
    whole = path.read_bytes()
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(MachineError, match=r"000001\.h5: damaged") as caught:
        read_step(path)
    assert "\n" not in str(caught.value)


def test_a_missing_step_and_a_foreign_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="cannot be read: No such file"):
        read_step(tmp_path / "steps" / "000001.h5")
    foreign = tmp_path / "foreign.h5"
    with h5py.File(foreign, "w") as file:
        file["x"] = 1.0
    with pytest.raises(MachineError, match="not a file of stickslip"):
        read_step(foreign)
    FieldFiles(job_of(tmp_path, mesh_of("triangle"))).write_index([])
    with pytest.raises(MachineError, match=r"fields\.h5: not a step"):
        read_step(tmp_path / "fields.h5")


def test_a_full_disk_leaves_the_old_step_and_no_rubbish(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = mesh_of("triangle")
    path = write_step(tmp_path, 1, result_of(mesh))
    before = path.read_bytes()

    make_full(monkeypatch)
    with pytest.raises(MachineError, match="cannot be written: No space left on device"):
        write_step(tmp_path, 1, result_of(mesh, seed=1))
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == ["000001.h5"]


def test_a_file_in_the_way_of_the_folder_is_said(tmp_path: Path) -> None:
    (tmp_path / "steps").write_text("")
    with pytest.raises(MachineError, match="steps: cannot be written: File exists"):
        write_step(tmp_path, 1, result_of(mesh_of("triangle")))


# XDMF
