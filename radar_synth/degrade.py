"""From what is in view to what the radar reports: missed detections, noise, clutter."""

from typing import Any

import numpy as np

from radar_synth import degrade_kernels as kernels
from radar_synth.radar import Radar, Scan, ScanTruth, Sightings, numbers
from sumo_net.surroundings import Objects

Array = np.ndarray[Any, Any]


def measure(
    radar: Radar, objects: Objects, seen: Sightings, keys: Array, counter: Array
) -> tuple[Scan, ScanTruth]:
    """What n radars report of their sightings, and what is behind it; keys (n,) uint64, counter (n,) int64.

    An echo is detected with P = P_fa^(1/(1+SNR)), a Swerling 1 target (Skolnik, Introduction to Radar
    Systems), times `most_likely`; SNR = SNR_0 (100 m / r)⁴ σ / 10 m², σ growing with the visible area, so
    that P falls with the range and with what is hidden. What comes out below the least range is not
    reported, nor is a body of which too little shows. Detections stand in the order of their measured range.
    """
    n, most = len(keys), radar.most_detections
    of_scan, of_truth = len(Scan._fields) - 1, len(ScanTruth._fields) - 2
    floats = np.full((of_scan + of_truth, n, most), np.nan)
    reported = Scan(np.zeros(n, np.int64), *floats[:of_scan])
    behind = ScanTruth(np.full((n, most), -1, np.int64), np.full((n, most), -1, np.int8), *floats[of_scan:])
    kernels.measure(objects, seen, numbers(radar), keys, counter, reported, behind)
    return reported, behind


def detection_probability(radar: Radar, range_m: Array, visible_m2: Array) -> Array:
    """P of a body of which an area of `visible_m2` is seen at `range_m`, as `measure` has it."""
    r = numbers(radar)
    snr = r.snr * r.cross_section * np.asarray(visible_m2) / np.asarray(range_m) ** 4
    return np.asarray(r.most_likely * np.exp(r.log_false_alarm / (1.0 + snr)))
