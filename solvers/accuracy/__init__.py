"""A posteriori error estimates of each reported number of a run: the parts of its error, in its own unit."""
