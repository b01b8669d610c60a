"""Kernel of the radar's measurement errors over the fleet.

Each scan of each vehicle has its own keys, and draws for a body depend on its handle, so that neither the
order nor the number of other bodies changes what is measured of one.
"""

import math

import numpy as np

from radar_synth.visibility_kernels import ascending
from sumo_net.compile import kernel
from sumo_net.randomness import bits, normal, uniform

_DRAWS = np.uint64(8)  # counters reserved for each body


@kernel
def _detected(r, area, radar, draw):  # type: ignore[no-untyped-def]
    """Whether an echo is detected (Swerling 1)."""
    snr = radar.snr * radar.cross_section * area / (r * r * r * r)
    return draw < radar.most_likely * math.exp(radar.log_false_alarm / (1.0 + snr))


@kernel
def _poisson(mean, draw):  # type: ignore[no-untyped-def]
    """A Poisson number by inversion of one uniform draw."""
    count, p = 0, math.exp(-mean)
    below = p
    while draw > below and count < 1000:
        count += 1
        p *= mean / count
        below += p
    return count


@kernel
def measure(objects, seen, radar, keys, counter, out, behind):  # type: ignore[no-untyped-def]
    """Scan and ScanTruth of n vehicles into `out` and `behind`, which must be empty."""
    n, M = objects.forward_m.shape
    most = out.range_m.shape[1]
    total = 0.0
    for k in range(radar.beam_angle.size):
        total += radar.beam_angle[k] * radar.beam_range[k]
    spare = 64
    z, truth = np.empty((2 * M + spare, 3)), np.empty((2 * M + spare, 5))
    handle, reflection = np.empty(2 * M + spare, np.int64), np.empty(2 * M + spare, np.int8)
    order = np.empty(2 * M + spare, np.int64)
    for i in range(n):
        scan = np.uint64(3) * np.uint64(counter[i])
        noise = bits(keys[i], scan)
        events = bits(keys[i], scan + np.uint64(1))
        clutter = bits(keys[i], scan + np.uint64(2))
        found = 0
        for m in range(M):
            if not seen.share[i, m] >= radar.least_share:  # NaN where nothing is in view
                continue
            own = np.uint64(objects.handle[i, m]) * _DRAWS
            area = seen.width_m[i, m] * objects.height_m[i, m]
            for point in range(2):
                if point == 0:
                    r, rate, azimuth = seen.range_m[i, m], seen.range_rate_mps[i, m], seen.azimuth_rad[i, m]
                    there = True
                else:
                    r, rate = seen.second_range_m[i, m], seen.second_range_rate_mps[i, m]
                    azimuth = seen.second_azimuth_rad[i, m]
                    there = (
                        math.isfinite(r) and uniform(events, own + np.uint64(2)) < radar.second_probability
                    )
                if not there or not _detected(r, area, radar, uniform(events, own + np.uint64(point))):
                    continue
                first = own + np.uint64(3 * point)
                measured = r + radar.range_noise * normal(noise, first)
                if measured < radar.minimum_range:
                    continue
                z[found, 0] = measured
                z[found, 1] = rate + radar.rate_noise * normal(noise, first + np.uint64(1))
                z[found, 2] = azimuth + radar.azimuth_noise * normal(noise, first + np.uint64(2))
                truth[found, 0], truth[found, 1], truth[found, 2] = r, rate, azimuth
                truth[found, 3], truth[found, 4] = seen.vx_mps[i, m], seen.vy_mps[i, m]
                handle[found], reflection[found] = objects.handle[i, m], point
                found += 1
        for j in range(min(_poisson(radar.clutter, uniform(clutter, 0)), spare)):
            at = np.uint64(4 * j + 1)
            # A beam drawn in proportion to angle times range, then uniform within it.
            pick, beam = uniform(clutter, at) * total, 0
            while (
                beam + 1 < radar.beam_angle.size and pick >= radar.beam_angle[beam] * radar.beam_range[beam]
            ):
                pick -= radar.beam_angle[beam] * radar.beam_range[beam]
                beam += 1
            low, high = radar.minimum_range, radar.beam_range[beam]
            z[found, 0] = low + (high - low) * uniform(clutter, at + np.uint64(1))
            z[found, 1] = radar.clutter_span * (2.0 * uniform(clutter, at + np.uint64(2)) - 1.0)
            z[found, 2] = radar.beam_angle[beam] * (2.0 * uniform(clutter, at + np.uint64(3)) - 1.0)
            handle[found], reflection[found] = -1, -1
            for part in range(5):
                truth[found, part] = math.nan
            found += 1
        ascending(z[:, 0], found, order)
        out.detections[i] = min(found, most)
        for j in range(out.detections[i]):
            k = order[j]
            out.range_m[i, j], out.range_rate_mps[i, j], out.azimuth_rad[i, j] = z[k, 0], z[k, 1], z[k, 2]
            behind.handle[i, j], behind.reflection[i, j] = handle[k], reflection[k]
            behind.range_m[i, j], behind.range_rate_mps[i, j] = truth[k, 0], truth[k, 1]
            behind.azimuth_rad[i, j] = truth[k, 2]
            behind.vx_mps[i, j], behind.vy_mps[i, j] = truth[k, 3], truth[k, 4]


@kernel
def used_places(scan):  # type: ignore[no-untyped-def]
    """Row and column, range, range rate and azimuth of the used slots of a Scan, (D,) each, row by row."""
    total = 0
    for i in range(len(scan.detections)):
        total += scan.detections[i]
    row, column = np.empty(total, np.int64), np.empty(total, np.int64)
    range_m, rate, azimuth = np.empty(total), np.empty(total), np.empty(total)
    d = 0
    for i in range(len(scan.detections)):
        for j in range(scan.detections[i]):
            row[d], column[d] = i, j
            range_m[d], rate[d] = scan.range_m[i, j], scan.range_rate_mps[i, j]
            azimuth[d] = scan.azimuth_rad[i, j]
            d += 1
    return row, column, range_m, rate, azimuth
