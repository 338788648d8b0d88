"""Cost of effects: counters of scenes with and without each effect and law; `stickslip verify effects`."""
