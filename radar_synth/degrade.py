"""From sightings to reported detections: missed detections, noise, clutter."""

import numpy as np

from radar_synth import degrade_kernels as kernels
from radar_synth.radar import Radar, Scan, ScanTruth, Sightings, numbers
from sumo_net.arrays import Array
from sumo_net.surroundings import Objects


def measure(
    radar: Radar, objects: Objects, seen: Sightings, keys: Array, counter: Array
) -> tuple[Scan, ScanTruth]:
    """Detections of n radars from their sightings, and the truth behind each.

    keys (n,) uint64, counter (n,) int64, as in `scan.scan`. An echo is detected with probability
    P_fa^(1/(1+SNR)), a Swerling 1 target (Skolnik, Introduction to Radar Systems), times `most_likely`;
    SNR = SNR_0 (100 m / r)⁴ σ / 10 m², with σ in proportion to the visible area. Measured ranges below the
    minimum and bodies with too small a visible share are not reported. Detections are sorted by range.
    """
    n, most = len(keys), radar.most_detections
    of_scan, of_truth = len(Scan._fields) - 1, len(ScanTruth._fields) - 2
    floats = np.full((of_scan + of_truth, n, most), np.nan)
    reported = Scan(np.zeros(n, np.int64), *floats[:of_scan])
    behind = ScanTruth(np.full((n, most), -1, np.int64), np.full((n, most), -1, np.int8), *floats[of_scan:])
    kernels.measure(objects, seen, numbers(radar), keys, counter, reported, behind)
    return reported, behind
