"""From a scene to displacement and contact tractions, step by step."""

import stickslip.geometry.dolfinx_versions  # noqa: F401  before any room imports PETSc
