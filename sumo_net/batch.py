"""Batches: NamedTuples of arrays whose first axis is the fleet (or the tracks); they may nest.

Numba takes them as one argument; a slice of one is a view. `select` and `join` remove and add vehicles.
Single arrays with a row for each handle grow by `longer`.
"""

from typing import Any, TypeVar

import numpy as np

from sumo_net.arrays import Array

B = TypeVar("B", bound=tuple[Any, ...])

ALL = slice(None)


def select(batch: B, index: Any) -> B:
    """The rows of a batch that `index` (slice, integers or mask) selects; a slice gives views.

    `ALL` gives the batch itself.
    """
    if index is ALL:
        return batch
    return type(batch)(*[select(part, index) if isinstance(part, tuple) else part[index] for part in batch])


def join(*batches: B) -> B:
    """Concatenate batches along the first axis; a single one is returned as it is."""
    if len(batches) == 1:
        return batches[0]
    parts = zip(*batches, strict=True)
    return type(batches[0])(*[join(*p) if isinstance(p[0], tuple) else np.concatenate(p) for p in parts])


def longer(table: Array, rows: int, fill: float = 0.0) -> Array:
    """The table itself where it has `rows` rows or more; else a copy of at least twice its length."""
    if rows <= len(table):
        return table
    made = np.full((max(rows, 2 * len(table)), *table.shape[1:]), fill, table.dtype)
    made[: len(table)] = table
    return made
