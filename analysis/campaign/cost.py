"""Estimated computing time and disk space of a campaign, before it runs."""

from collections.abc import Sequence

import dask

from analysis.campaign.plan import Run

START_S = 1.0  # core seconds per run: network, SUMO
PER_SIMULATED_S = 0.13  # core seconds, default scenario with 20 equipped vehicles
BYTES_PER_RUN = 75_000  # counts and events
KEPT_BYTES_PER_S = {
    "steps": 20_000,
    "predictions": 30_000,
    "tracks": 110_000,
}  # Parquet


def estimate(runs: Sequence[Run], keep: Sequence[str], workers: int | None = None) -> str:
    """Time and disk space as text, extrapolated from the default scenario on the measuring machine.

    keep : tables kept of every run.
    """
    count = workers or dask.system.CPU_COUNT
    recorded_s = sum(one.duration_s for one in runs)
    seconds = len(runs) * START_S + recorded_s * PER_SIMULATED_S
    disk = float(len(runs) * BYTES_PER_RUN)
    disk += sum(KEPT_BYTES_PER_S.get(name, 100) for name in keep) * recorded_s
    hours, minutes = seconds / 3600.0, seconds / 60.0 / count
    return (
        f"{recorded_s / 3600.0:.2f} h simulated: about {hours:.2f} core-hours ({minutes:.1f} min with "
        f"{count} workers) and {disk / 1e6:.1f} MB, by the default scenario with 20 equipped vehicles"
    )
