"""Versions of packages in result.json, and hashes of those from PyPI."""

import re
from pathlib import Path

import numpy as np
import pytest

from stickslip.workflows.run.packages import packages

ROOT = Path(__file__).resolve().parents[2]


def test_what_the_numbers_depend_on_is_listed_with_debians_versions() -> None:
    found = packages()
    for begin in ("libpetsc-real", "libdolfinx-real", "libmumps-", "libgmsh", "libopenblas0-pthread", "python3-gmsh"):
        assert any(name.startswith(begin) for name in found), begin
    assert found["numpy"] == np.__version__
    assert all(re.match(r"(\d+:)?\d+\.\d+", version) for version in found.values())
    assert not any(name.endswith(("-dev", "-doc")) for name in found)


def test_where_dolfinx_is_a_wheel_debians_packages_are_no_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stickslip.workflows.run.packages.version", lambda name: f"1.0+{name}")
    found = packages.__wrapped__()
    assert found["dolfinx-solver-real"] == "1.0+dolfinx-solver-real"
    assert {"gmsh", "h5py", "mpich", "numpy"} < set(found)
    assert not any(name.startswith(("lib", "python3-")) for name in found)


def test_every_package_of_pypi_is_pinned_with_a_hash() -> None:
    text = (ROOT / "requirements.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(lines) > 40
    pin, sha256 = r'[a-z0-9-]+==[\w.]+(; python_version [<>=]+ "3.12")?', r" +--hash=sha256:[0-9a-f]{64}"
    for line in lines:
        assert re.fullmatch(f"{pin}({sha256})+", line), line
