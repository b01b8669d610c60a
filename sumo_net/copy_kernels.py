"""Copying arrays in kernels.

numba compiles each `out[:] = source` with broadcasting and an error message; that took an eighth of the lane
tracker's compilation time (profiled).
"""

from sumo_net.compile import kernel


@kernel
def copy_vector(source, out):  # type: ignore[no-untyped-def]
    """out (n,) <- source (n,)."""
    for i in range(source.shape[0]):
        out[i] = source[i]


@kernel
def copy_matrix(source, out):  # type: ignore[no-untyped-def]
    """out (n, m) <- source (n, m)."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]
