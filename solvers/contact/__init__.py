"""Contact operators and rows (nodal displacement to relative displacement), dual multipliers, the admissible set."""
