"""The speed that bends ahead allow, against what braking evenly to them means."""

import math

import numpy as np
import pytest

from sumo_net.bend_speed_kernels import bend_speeds
from sumo_net.road_table import MAX_BORDERS, RoadTable

LATERAL, BRAKING, RADIUS = 4.0, 2.0, 25.0


@pytest.fixture(scope="module")
def road():
    """100 m straight, then a right-hand bend of 25 m for 20 m, then straight; one path, a sample a metre."""
    count = 201
    zeros, x = np.zeros(count), np.arange(float(count))
    curvature = np.where((x >= 100.0) & (x <= 120.0), -1.0 / RADIUS, 0.0)
    return RoadTable(
        *(np.array([v]) for v in (0, count)), *(np.array([v]) for v in (1.0, 0.0, 200.0, 200.0)),
        np.array([0]), np.array([1]), x, zeros, zeros, curvature,
        np.zeros(1), np.zeros(1), np.ones(1), np.full((1, MAX_BORDERS), np.nan),
        np.zeros((1, MAX_BORDERS), np.int8), np.zeros(1), np.zeros(1),
    )  # fmt: skip


@pytest.mark.parametrize("speed", [14.0, 17.0, 20.0])
def test_brakes_evenly_down_to_the_bend_and_not_before(road, speed):
    in_bend = math.sqrt(LATERAL * RADIUS)
    station, first, start_m = 0.0, speed, math.nan
    while station < 119.0:
        path = np.zeros(1, np.int64)
        allowed = bend_speeds(road, path, np.array([station]), np.array([speed]), LATERAL, BRAKING)
        wanted = min(speed, float(allowed[0]))
        assert wanted <= speed
        if wanted < speed and math.isnan(start_m):
            start_m = station
        speed = wanted
        station += 0.1 * speed
        if station >= 100.0:
            assert speed <= in_bend * 1.02
    assert 0.5 * (first**2 - in_bend**2) / (100.0 - start_m) == pytest.approx(BRAKING, rel=0.1)


def test_a_straight_road_and_what_lies_behind_bound_nothing(road):
    at = np.array([0.0, 130.0])
    free = bend_speeds(road, np.zeros(2, np.int64), at, np.array([10.0, 30.0]), LATERAL, BRAKING)
    assert np.isinf(free).all()
