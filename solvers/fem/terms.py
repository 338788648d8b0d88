"""What loads and effects add to the weak form: loads, and initial strains, each with its value in time."""

from __future__ import annotations

from dataclasses import dataclass

from geometry.arrays import Array
from geometry.protocols import UflForm
from solvers.scene.timeline import Drive


@dataclass(frozen=True, kw_only=True)
class LoadTerm:
    """A load: a linear form in the test function at value 1 [N], and the value in time that multiplies it."""

    drive: Drive
    form: UflForm


@dataclass(frozen=True, kw_only=True)
class InitialStrain:
    """A strain that a body takes on where nothing holds it, uniform over the body, times a value in time.

    Stress belongs to the strain beyond it. It loads the bodies, changes stored energy and stress, and the work that it
    does on the stressed bodies counts as external.
    """

    drive: Drive
    body: str
    strain: Array  # (3, 3) at value 1 [-], symmetric; the third axis is out of plane, in axisymmetric models the hoop
