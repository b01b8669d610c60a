"""Small statistics that several figures share."""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from scipy.stats import chi2


def poisson_interval(count: int, level: float = 0.95) -> tuple[float, float]:
    """The exact (Garwood) interval of a Poisson mean."""
    tail = (1.0 - level) / 2.0
    low = float(chi2.ppf(tail, 2 * count) / 2.0) if count else 0.0
    return low, float(chi2.ppf(1.0 - tail, 2 * count + 2) / 2.0)


def per_100_km(count: float, km: float) -> float:
    """A rate per 100 km, NaN where nothing was driven."""
    return 100.0 * count / km if km > 0.0 else float("nan")


def mean(values: Iterable[bool]) -> float:
    """Share of True; NaN of nothing."""
    array = np.asarray(list(values), dtype=float)
    return float(array.mean()) if len(array) else float("nan")


def quantile(values: pd.Series, q: float) -> float:
    """The next higher observation at q; NaN of nothing."""
    if values.empty:
        return float("nan")
    return float(np.quantile(values.to_numpy(), q, method="higher"))
