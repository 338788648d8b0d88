"""What MPI ranks share: gather, replicate, serialise; counters of work, memory in use."""
