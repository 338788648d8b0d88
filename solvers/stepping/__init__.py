"""Load steps: choice of the method, state, substeps, and what happens when a step fails."""
