"""MPI ranks together: gather and scatter, replicated entries, serialisation, counters of work, and the clock."""
