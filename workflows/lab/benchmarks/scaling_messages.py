"""Messages that libraries send without a log, hypre above all: a small library that is loaded before MPI counts them.

PETSc's own messages are persistent requests and stand in its log; what is counted here is sent by other calls.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from pathlib import Path

SOURCE = """#include <mpi.h>
long stickslip_counted[4];  /* messages, their bytes, collectives, their bytes */
static void count(int at, long n, MPI_Datatype type) {
    int size;
    PMPI_Type_size(type, &size);
    stickslip_counted[at] += 1;
    stickslip_counted[at + 1] += n * size;
}
int MPI_Isend(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c, MPI_Request *r) {
    count(0, n, t);
    return PMPI_Isend(b, n, t, to, tag, c, r);
}
int MPI_Send(const void *b, int n, MPI_Datatype t, int to, int tag, MPI_Comm c) {
    count(0, n, t);
    return PMPI_Send(b, n, t, to, tag, c);
}
int MPI_Allreduce(const void *b, void *to, int n, MPI_Datatype t, MPI_Op op, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allreduce(b, to, n, t, op, c);
}
int MPI_Allgather(const void *b, int n, MPI_Datatype t, void *to, int m, MPI_Datatype u, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allgather(b, n, t, to, m, u, c);
}
int MPI_Allgatherv(const void *b, int n, MPI_Datatype t, void *to, const int *m, const int *d, MPI_Datatype u,
                   MPI_Comm c) {
    count(2, n, t);
    return PMPI_Allgatherv(b, n, t, to, m, d, u, c);
}
int MPI_Bcast(void *b, int n, MPI_Datatype t, int from, MPI_Comm c) {
    count(2, n, t);
    return PMPI_Bcast(b, n, t, from, c);
}
"""
KEYS = ("messages", "bytes", "collectives", "collective_bytes")


def build(folder: Path) -> Path | None:
    """The library, compiled in a folder; None where there is no mpicc."""
    compiler = shutil.which("mpicc")
    if compiler is None:
        return None
    source, library = folder / "counted.c", folder / "counted.so"
    source.write_text(SOURCE)
    subprocess.run([compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    return library


def counted() -> dict[str, int]:
    """Counts of this rank so far; zeros where the library is not loaded (LD_PRELOAD)."""
    try:
        values = (ctypes.c_long * len(KEYS)).in_dll(ctypes.CDLL(None), "stickslip_counted")
    except ValueError:
        return dict.fromkeys(KEYS, 0)
    return dict(zip(KEYS, values, strict=True))
