"""What a person runs: the scene file, the command line, the run, its results."""

VERSION = "0.1.0"
