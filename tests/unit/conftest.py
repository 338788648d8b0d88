"""Small blocks to try the parts on: a scene in a few words, its system, its steps."""

import pytest

from shared import problems
from shared.problems import SceneOf, SimulationOf, SystemOf
from stickslip.solvers.simulation import simulation
from stickslip.workflows.lab.verification import prepared


@pytest.fixture(scope="session")
def scene_of() -> SceneOf:
    """A block on a foundation; keywords replace or add whole tables."""
    return problems.scene_of


@pytest.fixture(scope="session")
def system_of() -> SystemOf:
    """The scene meshed and assembled; nothing is factorised."""
    return prepared.system_of


@pytest.fixture(scope="session")
def simulation_of() -> SimulationOf:
    """The scene ready to be solved, without estimates of errors."""
    return prepared.prepare


@pytest.fixture(scope="session")
def estimating() -> SimulationOf:
    """The scene ready to be solved, with estimates of errors."""
    return simulation.prepare
