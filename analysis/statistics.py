"""Statistics shared by several figures."""

from collections.abc import Iterable, Sequence

import numpy as np
import pandas as pd
from scipy.stats import binomtest, bootstrap, chi2

from sumo_net.arrays import Array

RESAMPLES = 1000
_TINY = np.finfo(np.float64).tiny  # makes the ratio 0 if all rows drawn are 0
_NUMBERS_AT_ONCE = 1_000_000  # drawn at a time, bounds the memory


def poisson_interval(count: int, level: float = 0.95) -> tuple[float, float]:
    """The exact (Garwood) interval of a Poisson mean."""
    tail = (1.0 - level) / 2.0
    low = float(chi2.ppf(tail, 2 * count) / 2.0) if count else 0.0
    return low, float(chi2.ppf(1.0 - tail, 2 * count + 2) / 2.0)


def wilson_interval(count: int, number: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    interval = binomtest(count, number).proportion_ci(0.95, "wilson")
    return float(interval.low), float(interval.high)


def per_100_km(count: float, km: float) -> float:
    """A rate per 100 km, NaN without distance."""
    return 100.0 * count / km if km > 0.0 else float("nan")


def mean(values: Iterable[bool]) -> float:
    """Share of True; NaN without values."""
    array = np.asarray(list(values), dtype=float)
    return float(array.mean()) if len(array) else float("nan")


def quantile(values: pd.Series, q: float) -> float:
    """The next higher observation at q; NaN without values."""
    if values.empty:
        return float("nan")
    return float(np.quantile(values.to_numpy(), q, method="higher"))


def ratio_interval(numerator: Array, denominator: Array) -> tuple[float, float]:
    """95 % bootstrap interval over rows of Σ numerator / Σ denominator; NaN for fewer than two rows."""
    if len(numerator) < 2 or not np.sum(denominator):
        return float("nan"), float("nan")
    interval = bootstrap(
        (np.asarray(numerator, np.float64), np.asarray(denominator, np.float64)),
        lambda total, count, axis: total.sum(axis=axis) / np.maximum(count.sum(axis=axis), _TINY),
        paired=True,
        vectorized=True,
        method="percentile",
        n_resamples=RESAMPLES,
        batch=max(1, _NUMBERS_AT_ONCE // len(numerator)),
        rng=np.random.default_rng(0),
    ).confidence_interval
    return float(interval.low), float(interval.high)


def ratio_difference_intervals(
    numerators: Sequence[Array], denominators: Sequence[Array], resamples: int = RESAMPLES
) -> tuple[Array, Array, Array]:
    """Ratios of sums of two paired samples, and 95 % bootstrap intervals of the second minus the first.

    Two arrays (n, F) each: n pairs, F figures. Pairs are drawn together. Returns ratios (2, F), low and high
    (F,); a ratio is NaN where its denominator is 0, an interval also for fewer than two pairs.
    """
    parts = [np.asarray(part, np.float64) for part in (*numerators, *denominators)]
    n, F = parts[0].shape
    with np.errstate(divide="ignore", invalid="ignore"):
        ratios = np.stack([parts[k].sum(axis=0) / parts[k + 2].sum(axis=0) for k in range(2)])
        if n < 2:
            return ratios, np.full(F, np.nan), np.full(F, np.nan)
        random, drawn = np.random.default_rng(0), np.empty((resamples, F))
        for k in range(resamples):
            times = random.multinomial(n, np.full(n, 1.0 / n))
            a, b, per_a, per_b = (times @ part for part in parts)
            drawn[k] = b / per_b - a / per_a
    known = np.where(np.isfinite(ratios).all(axis=0), drawn, np.nan)
    low, high = np.full((2, F), np.nan)
    for k in range(F):
        values = known[np.isfinite(known[:, k]), k]
        if len(values):
            low[k], high[k] = np.quantile(values, (0.025, 0.975))
    return ratios, low, high


def quantile_ratio_interval(
    numerator: pd.Series, denominator: pd.Series, cluster: Array, q: float
) -> tuple[float, float]:
    """95 % bootstrap interval of quantile(numerator, q) / quantile(denominator, q) of paired rows (N,).

    Resampled by cluster: `cluster` (N,) numbers them from 0. NaN for fewer than two.
    """
    clusters = int(cluster.max()) + 1 if len(cluster) else 0
    if clusters < 2:
        return float("nan"), float("nan")
    random = np.random.default_rng(0)
    ratios = np.full(RESAMPLES, np.nan)
    for k in range(RESAMPLES):
        times = random.multinomial(clusters, np.full(clusters, 1.0 / clusters))
        drawn = np.repeat(np.arange(len(cluster)), times[cluster])
        over = quantile(denominator.iloc[drawn], q)
        ratios[k] = quantile(numerator.iloc[drawn], q) / over if over > 0.0 else np.inf
    low, high = np.quantile(ratios, (0.025, 0.975), method="higher")  # no mean: one may be infinite
    return float(low), float(high)


def clustered_share(rows: pd.DataFrame, column: str) -> tuple[float, float, float]:
    """Share of True in `column`, with a 95 % bootstrap interval over (run, vehicle): their frames are alike.

    The interval is NaN for fewer than two vehicles, the share without rows too.
    """
    per_vehicle = rows.groupby(["run_id", "vehicle_id"], observed=True)[column].agg(["sum", "count"])
    hits, count = (per_vehicle[name].to_numpy(np.float64) for name in ("sum", "count"))
    share = float(hits.sum() / count.sum()) if count.sum() else float("nan")
    return share, *ratio_interval(hits, count)
