"""A scene prepared and marched: plan, simulation, script, checkpoint."""
