"""What ranks share: gathering, replicated entries, serialisation, counters of work, memory."""
