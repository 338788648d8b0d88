"""How accurate each reported number of a run is: the parts of its error, in its own unit."""
