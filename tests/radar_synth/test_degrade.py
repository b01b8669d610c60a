"""Noise, misses and clutter: their statistics, and that they depend only on vehicle and scan."""

import math

import numpy as np
import pytest
from pydantic import ValidationError

from radar_synth.radar import Beam, OwnMotion, Radar, Scan, ScanTruth
from radar_synth.scan import flatten, scan
from sumo_net.batch import select
from sumo_net.randomness import stream_key
from sumo_net.surroundings import Objects
from tests.roads import objects_at

CAR = {"forward_m": 60.0, "left_m": 0.0}
LORRY = {
    "forward_m": 100.0,
    "left_m": -6.0,
    "length_m": 14.0,
    "width_m": 2.5,
    "height_m": 3.8,
    "heading_rad": 0.05,
}


def keys(n: int, seed: int = 1) -> np.ndarray:
    return np.array([stream_key(seed, f"vehicle {i}", "radar") for i in range(n)], np.uint64)


def motion(n: int) -> OwnMotion:
    return OwnMotion(np.full(n, 30.0), np.zeros(n), np.zeros(n))


def scans(radar: Radar, bodies: list[dict[str, float]], n: int) -> tuple[Scan, ScanTruth]:
    """n scans of the same scene by one vehicle."""
    key = np.repeat(keys(1), n)
    out = scan(radar, objects_at([bodies] * n, max(len(bodies), 1)), motion(n), key, np.arange(n))
    return out[0], out[1]


def test_noise_has_the_set_deviations_and_no_bias() -> None:
    radar, n = Radar(most_likely=1.0, snr_db=90.0, clutter_rate=0.0), 20_000
    z, truth = scans(radar, [CAR], n)
    assert (z.detections == 1).all()
    for error, sigma in (
        (z.range_m - truth.range_m, 1.0),
        (z.range_rate_mps - truth.range_rate_mps, 0.5),
        (z.azimuth_rad - truth.azimuth_rad, math.radians(0.2)),
    ):
        assert np.mean(error[:, 0]) == pytest.approx(0.0, abs=4 * sigma / math.sqrt(n))
        assert np.std(error[:, 0]) == pytest.approx(sigma, rel=4 / math.sqrt(2 * n))
        lag = np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]
        assert abs(lag) < 4 / math.sqrt(n)
    pairs = np.corrcoef(
        np.stack([(z.range_m - truth.range_m)[:, 0], (z.azimuth_rad - truth.azimuth_rad)[:, 0]])
    )
    assert abs(pairs[0, 1]) < 4 / math.sqrt(n)


@pytest.mark.parametrize(
    ("forward_m", "height_m", "snr_db"),
    [(100.0, 1.5, 35.0), (190.0, 1.5, 35.0), (190.0, 1.5, 20.0), (150.0, 0.2, 35.0)],
)
def test_misses_follow_the_published_probability(forward_m: float, height_m: float, snr_db: float) -> None:
    n, radar = 20_000, Radar(clutter_rate=0.0, snr_db=snr_db)
    z, truth = scans(radar, [CAR | {"forward_m": forward_m, "height_m": height_m}], n)
    r = np.nanmean(truth.range_m[:, 0])
    area = height_m * 2 * r * math.atan(0.9 / r)
    snr = 10 ** (snr_db / 10) * (3.7 * area / 10.0) * (100.0 / r) ** 4
    expected = 0.98 * 1e-6 ** (1 / (1 + snr))
    assert z.detections.mean() == pytest.approx(expected, abs=4 * math.sqrt(0.25 / n))


def test_clutter_is_a_poisson_number_spread_over_the_field_of_view() -> None:
    radar, n = Radar(clutter_rate=0.8), 10_000
    z, truth = scans(radar, [], n)
    assert z.detections.mean() == pytest.approx(0.8, abs=4 * math.sqrt(0.8 / n))
    assert z.detections.var() == pytest.approx(0.8, rel=0.1)
    flat = flatten(z)
    assert (truth.handle == -1).all()
    assert np.isnan(truth.range_m).all()
    outside = np.abs(flat.azimuth_rad) > math.radians(10.0)
    assert (flat.range_m[outside] <= 60.0).all()
    assert (flat.range_m >= 0.5).all()
    assert (flat.range_m <= 200.0).all()
    assert 0.2 < outside.mean() < 0.6
    assert np.corrcoef(np.stack([flat.range_m[~outside], flat.range_rate_mps[~outside]]))[
        0, 1
    ] == pytest.approx(0, abs=0.05)


def test_a_lorry_answers_twice() -> None:
    _, truth = scans(Radar(clutter_rate=0.0), [LORRY], 5000)
    assert (truth.reflection == 0).any(axis=1).mean() > 0.95
    assert (truth.reflection == 1).any(axis=1).mean() == pytest.approx(0.6 * 0.98, abs=0.04)
    both = (truth.reflection == 0).any(axis=1) & (truth.reflection == 1).any(axis=1)
    first = np.where(truth.reflection == 0, truth.range_m, 0.0).max(axis=1)[both]
    second = np.where(truth.reflection == 1, truth.range_m, 0.0).max(axis=1)[both]
    assert (second - first) == pytest.approx(np.full(both.sum(), 7.0), abs=0.3)
    assert (truth.handle[truth.reflection >= 0] == 1).all()


def crowd(n: int, bodies: int = 12, seed: int = 5) -> Objects:
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(n):
        x = np.sort(rng.uniform(8.0, 180.0, bodies))
        rows.append(
            [
                {
                    "forward_m": v,
                    "left_m": rng.choice([-3.75, 0.0, 3.75, 12.0]),
                    "handle": int(h),
                    "speed_mps": 20.0,
                }
                for v, h in zip(x, rng.permutation(1000)[:bodies] - 500, strict=True)
                if h not in (-1,)
            ]
        )
    return objects_at(rows, bodies)


def test_neither_slices_nor_the_order_of_bodies_changes_a_byte() -> None:
    n = 12
    radar, objects, key, counter = Radar(clutter_rate=1.0), crowd(n), keys(n), np.arange(n) + 40
    whole = scan(radar, objects, motion(n), key, counter)
    part = scan(radar, select(objects, slice(3, 8)), motion(5), key[3:8], counter[3:8])
    for a, b in zip((*whole[0], *whole[1]), (*part[0], *part[1]), strict=True):
        np.testing.assert_array_equal(a[3:8], b)
    order = np.random.default_rng(0).permutation(objects.handle.shape[1])
    mixed = scan(
        radar, Objects(*(np.ascontiguousarray(c[:, order]) for c in objects)), motion(n), key, counter
    )
    for a, b in zip((*whole[0], *whole[1]), (*mixed[0], *mixed[1]), strict=True):
        np.testing.assert_array_equal(a, b)
    fewer = Objects(*(column[:, :8] for column in objects))
    alone = scan(radar, Objects(*(np.ascontiguousarray(c) for c in fewer)), motion(n), key, counter)
    # The noise of a body is its own: what is still seen in the same place is measured the same.
    for i in range(n):
        common = set(alone[0].range_m[i][:3]) & set(whole[0].range_m[i])
        assert common


def test_scans_and_vehicles_are_independent_and_repeatable() -> None:
    objects = objects_at([[CAR], [CAR]], 1)
    radar = Radar(clutter_rate=0.0, most_likely=1.0)
    one = scan(radar, objects, motion(2), keys(2), np.array([7, 7]))[0]
    again = scan(radar, objects, motion(2), keys(2), np.array([7, 7]))[0]
    later = scan(radar, objects, motion(2), keys(2), np.array([8, 8]))[0]
    np.testing.assert_array_equal(one.range_m, again.range_m)
    assert one.range_m[0, 0] != one.range_m[1, 0]
    assert one.range_m[0, 0] != later.range_m[0, 0]


def test_order_tells_nothing_of_the_truth() -> None:
    z, truth = scans(Radar(clutter_rate=2.0), [CAR, LORRY, CAR | {"forward_m": 150.0, "left_m": 7.0}], 300)
    for i in range(300):
        r = z.range_m[i, : z.detections[i]]
        assert (np.diff(r) >= 0).all()
        assert np.isnan(z.range_m[i, z.detections[i] :]).all()
        assert (truth.handle[i, z.detections[i] :] == -1).all()
    flat = flatten(z)
    assert len(flat.owner) == z.detections.sum()
    np.testing.assert_array_equal(flat.range_m, z.range_m[flat.owner, flat.column])


def test_more_detections_than_places_keep_the_nearest() -> None:
    z, _ = scans(Radar(clutter_rate=15.0, most_detections=4), [CAR], 200)
    full, _ = scans(Radar(clutter_rate=15.0, most_detections=48), [CAR], 200)
    np.testing.assert_array_equal(z.range_m, full.range_m[:, :4])


def test_settings_say_what_is_wrong() -> None:
    with pytest.raises(ValidationError, match=r"minimum_range_m = 5.0: must be below"):
        Radar(beams=(Beam(half_angle_rad=0.2, range_m=4.0),), minimum_range_m=5.0)
    with pytest.raises(ValidationError):
        Radar(beams=())
