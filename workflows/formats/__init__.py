"""File formats of the results: files written whole or not at all, checksummed HDF5, CSV tables, cell shapes."""
