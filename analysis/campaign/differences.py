"""Settings compared in pairs: the same seeds under two values of one key of the grid."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pandas as pd

from analysis.campaign.growth import cell_name
from analysis.statistics import ratio_difference_intervals


def differences(cells: list[dict[str, Any]], runs: pd.DataFrame, figures: Mapping[str, str]) -> pd.DataFrame:
    """Each figure under each other value of a key, minus that under the key's first value; paired by seed.

    `figures`: the column of `runs` that each is divided by, by name. `runs` has one row per run.
    """
    rows = []
    for key, base, other in _pairs(cells):
        first, second = (runs[runs["cell"] == one].set_index("seed") for one in (base, other))
        seeds = sorted(set(first.index) & set(second.index))
        counts = [part.loc[seeds, list(figures)].to_numpy(np.float64) for part in (first, second)]
        of = [part.loc[seeds, list(figures.values())].to_numpy(np.float64) for part in (first, second)]
        ratios, low, high = ratio_difference_intervals(counts, of)
        label = {"key": key, "from": str(cells[base][key]), "to": str(cells[other][key])}
        label |= {name: str(value) for name, value in cells[base].items() if name != key}
        for k, name in enumerate(figures):
            rows.append(
                label
                | {
                    "figure": name,
                    "pairs": len(seeds),
                    "count_from": int(counts[0][:, k].sum()),
                    "count_to": int(counts[1][:, k].sum()),
                    "value_from": ratios[0][k],
                    "value_to": ratios[1][k],
                    "difference": ratios[1][k] - ratios[0][k],
                    "difference_low": low[k],
                    "difference_high": high[k],
                }
            )
    return pd.DataFrame(rows)


def _pairs(cells: list[dict[str, Any]]) -> Iterator[tuple[str, int, int]]:
    """(key, cell, other cell): cells that differ only in one key, the first with the key's first value."""
    number = {cell_name(cell): k for k, cell in enumerate(cells)}
    for key in cells[0] if cells else ():
        first = cells[0][key]
        for other, cell in enumerate(cells):
            base = number.get(cell_name(cell | {key: first}))
            if cell[key] != first and base is not None:
                yield key, base, other
