"""MPI ranks together: gather, scatter, replicated entries, shared rows, serialisation, counters of work, the clock."""
