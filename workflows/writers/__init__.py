"""Result files: steps (HDF5), fields (XDMF), tables (CSV), result.json."""
