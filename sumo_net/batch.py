"""Batches: NamedTuples of arrays whose first axis is the fleet (or the tracks).

Numba takes them as one argument, a slice of one is a view, and vehicles come and go by `select` and `join`.
"""

from typing import Any, TypeVar

import numpy as np

B = TypeVar("B", bound=tuple[Any, ...])


def select(batch: B, index: Any) -> B:
    """The same batch for the vehicles that `index` (slice, integers or mask) names; a slice gives views."""
    return type(batch)(*(part[index] for part in batch))


def join(first: B, second: B) -> B:
    """One batch after the other."""
    return type(first)(*(np.concatenate(parts) for parts in zip(first, second, strict=True)))
