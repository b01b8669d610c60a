"""Copying arrays in kernels.

numba compiles `out[:] = source` with broadcasting and the text of an error for each place where it stands;
that was an eighth of the time (profiled) that the lane tracker took to compile.
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
