"""Results of a step: fields, contact states, error estimates, audit."""
