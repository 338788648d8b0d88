"""What effects cost: counters of scenes with and without each effect and law; `stickslip verify effects`."""
