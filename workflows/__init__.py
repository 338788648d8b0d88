"""The programs that a person runs: scene files, commands, runs and their results, verification, studies."""
