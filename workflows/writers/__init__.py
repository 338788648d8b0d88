"""Result files: steps (HDF5), fields (XDMF), tables (CSV) and pictures (PNG). Rank 0 only; the caller sees to that."""
