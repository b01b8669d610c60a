"""Patterns stand in the world: they move with the road; strengths do what they say."""

import numpy as np
import pytest
from shots import ASPHALT, PAINT, plain, row_of, shoot

from camera_synth.camera import Camera, projection, vehicle_from_image
from camera_synth.condition import preset
from camera_synth.degrade import noise_line, value_noise
from camera_synth.light_kernels import overpass_at
from sumo_net.road import SOLID
from tests.roads import road_ahead

P = projection(Camera())
BARE = road_ahead(kinds=[0] * 6, lanes_right=2, lanes_left=2, shoulder_m=40.0)


def ground(frame: np.ndarray, pose: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """World positions (k, 2) and greys of a grid of pixels."""
    places, greys = [], []
    for y in range(0, 120, 2):
        for x in range(10, 310, 6):
            forward, left = vehicle_from_image(x, y, P)
            c, s = np.cos(pose[2]), np.sin(pose[2])
            places.append((pose[0] + c * forward - s * left, pose[1] + s * forward + c * left))
            greys.append(row_of(frame, y)[x])
    return np.array(places), np.array(greys)


@pytest.mark.parametrize(
    ("strengths", "least"),
    [({"texture": 12.0}, 0.85), ({"shadow": 0.7, "shadow_cover": 0.5}, 0.9)],
)
def test_patterns_stay_where_they_are(strengths: dict[str, float], least: float) -> None:
    """Grey against grey of the same places, seen from 6 m further on and another heading."""
    from scipy.interpolate import griddata

    road = BARE
    condition = plain(**strengths)
    here, there = (500.0, 80.0, 0.7), (500.0 + 6.0 * np.cos(0.7), 80.0 + 6.0 * np.sin(0.7), 0.72)
    first, second = (shoot(road, condition, pose=pose)[0] for pose in (here, there))
    places, greys = ground(first, here)
    places_2, greys_2 = ground(second, there)
    again = griddata(places_2, greys_2, places, method="linear")
    near = np.isfinite(again) & (np.hypot(*(places - np.array(here[:2])).T) < 25.0)
    assert near.sum() > 300
    assert np.std(greys[near]) > 3.0
    assert np.corrcoef(greys[near], again[near])[0, 1] > least
    # and not where it would be had it moved with the camera
    assert np.corrcoef(first[150:].ravel(), second[150:].ravel())[0, 1] < 0.6


def test_row_noise_is_the_point_noise() -> None:
    out = np.zeros(81, np.float32)
    noise_line(out, 1e6 + 0.3, -2e5 + 0.7, 0.13, -0.21, 7)
    expected = [value_noise(1e6 + 0.3 + 0.13 * i, -2e5 + 0.7 - 0.21 * i, 7) for i in range(81)]
    np.testing.assert_allclose(out, expected, atol=2e-4)
    draws = np.array([value_noise(u + 0.37, 0.5 * u, 3) for u in range(20000)])
    assert abs(draws.mean()) < 0.02
    assert np.abs(draws).max() <= 1.0
    lattice = np.array([value_noise(u, 7.0, 3) for u in range(20000)])
    assert lattice.std() == pytest.approx(1 / np.sqrt(3), rel=0.02)  # uniform in [-1, 1) at lattice points


def test_shadow_takes_its_share_of_the_light() -> None:
    condition = plain(shadow=0.6, shadow_cover=0.4)
    shares = []
    for k in range(12):
        frame = shoot(BARE, condition, pose=(211.0 * k, 37.0 * k, 0.5 * k))[0][120:].astype(float)
        assert frame.min() >= ASPHALT * 0.4 - 1.0
        assert frame.max() <= ASPHALT + 1.0
        shares.append(np.mean(frame < 0.7 * ASPHALT))
    assert 0.2 < np.mean(shares) < 0.6


def test_overpass_is_a_band_across_the_road() -> None:
    spacing = 300.0
    near, far = overpass_at(1200.0, spacing, 1)
    assert 8.0 <= far - near <= 18.0
    road = road_ahead(station_m=near - 20.0, kinds=[0] * 4, shoulder_m=40.0)
    frame = shoot(road, plain(overpass=0.8, overpass_spacing_m=spacing))[0]
    for y in range(0, 130):
        forward, _ = vehicle_from_image(160, y, P)
        footprint = max(1.0, forward**2 / 1240.0)
        station = near - 20.0 + forward
        grey = row_of(frame, y)[160]
        if near + footprint < station < far - footprint:
            assert grey == pytest.approx(0.2 * ASPHALT, abs=1.5)
        elif station < near - footprint or station > far + footprint:
            assert grey == pytest.approx(ASPHALT, abs=1.5)


def test_wear_and_missing_paint() -> None:
    road = road_ahead(kinds=[SOLID] * 4)

    def contrast(**strengths: float) -> np.ndarray:
        found = []
        for k in range(40):
            frame = shoot(road, plain(**strengths), pose=(97.0 * k, 13.0 * k, 0.0))[0]
            for y in range(50, 130, 8):
                x = int(160 - 925 * 1.875 / (1.34 * 925 / (157 - y)))
                found.append(np.max(row_of(frame, y)[max(0, x - 3) : x + 4]) - ASPHALT)
        return np.array(found) / (PAINT - ASPHALT)

    new, worn = contrast(), contrast(wear=0.8)
    assert new.min() > 0.95
    assert 0.3 < worn.mean() < 0.7
    assert worn.std() > 0.1
    assert worn.min() > 0.15  # 1 - wear is left at the least
    for share in (0.1, 0.3):
        gone = np.mean(contrast(missing=share) < 0.5)
        assert gone == pytest.approx(share, abs=0.07)


def test_glare_only_towards_the_sun() -> None:
    road = road_ahead()
    condition = plain(glare=0.6, sun_azimuth_rad=1.0)
    towards, away = (shoot(road, condition, pose=(0.0, 0.0, heading))[0] for heading in (1.0, 1.0 + np.pi))
    clean = shoot(road, plain())[0]
    np.testing.assert_array_equal(away[100:], clean[100:])
    assert towards[100:].mean() > clean[100:].mean() + 30
    assert towards[100:].std() < 0.8 * clean[100:].std()


def test_drift_is_slow_and_bounded() -> None:
    road = road_ahead(kinds=[0] * 4)
    condition = plain(drift=0.3, drift_frames=50.0)
    level = np.array(
        [shoot(road, condition, counter=c, first_row=150)[0][200, 160] for c in range(0, 600, 5)]
    )
    level = level / ASPHALT
    assert 0.69 < level.min() < 0.9
    assert 1.1 < level.max() < 1.31
    assert np.abs(np.diff(level)).max() < 0.12


def test_night_falls_off_with_the_distance() -> None:
    frame = shoot(BARE, preset("night", texture=0.0, noise_grey=0.0, drift=0.0))[0]
    assert row_of(frame, 5)[160] > 2.0 * row_of(frame, 120)[160]


def test_presets() -> None:
    with pytest.raises(ValueError, match="complex"):
        preset("nice")
    assert preset("clear", noise_grey=5.0).noise_grey == 5.0
    with pytest.raises(ValueError, match="noise_grey"):
        preset("clear", noise_grey=-1.0)
