"""Work space on the stack: kernels that use it agree with numpy."""

import numpy as np
import pytest
from numba.core.errors import TypingError

from sumo_net.compile import kernel
from sumo_net.scratch import scratch

SIZE = 3


@kernel
def _products(A, B):  # type: ignore[no-untyped-def]
    out, row, M = np.empty_like(A), scratch(SIZE), scratch((SIZE, SIZE))
    for t in range(len(A)):
        for i in range(SIZE):
            for j in range(SIZE):
                row[j] = 0.0
                for k in range(SIZE):
                    row[j] += A[t, i, k] * B[t, k, j]
            M[i] = row
        out[t] = M
    return out


@kernel
def _of_unknown_size(n):  # type: ignore[no-untyped-def]
    return scratch(n)[0]


def test_holds_what_is_written() -> None:
    A, B = np.random.default_rng(1).standard_normal((2, 50, SIZE, SIZE))
    np.testing.assert_allclose(_products(A, B), A @ B, rtol=1e-12, atol=1e-15)


def test_size_must_be_constant() -> None:
    with pytest.raises(TypingError):
        _of_unknown_size(3)
