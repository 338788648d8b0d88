"""What an accepted step says: fields, contact states, error estimates, audit."""
