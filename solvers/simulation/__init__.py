"""A scene, prepared and solved: plan, simulation, script, checkpoint."""
