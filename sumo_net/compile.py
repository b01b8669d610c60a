"""The one way in which this project compiles: cached numba kernels that release the GIL.

Kernels take arrays over the fleet, as plain arrays or as NamedTuples of arrays, and loop over the
vehicles inside. Threads, where they help, each get a slice of the fleet.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

_F = TypeVar("_F", bound=Callable[..., Any])


def kernel(function: _F) -> _F:
    """Compile `function` in nopython mode at its first call and keep the result on disk."""
    compiled: Any = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return compiled
