"""Objects around against a loop that does it vehicle by vehicle."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sumo_net.arrays import Array
from sumo_net.batch import select
from sumo_net.surroundings import Objects, objects_around
from sumo_net.traffic import Snapshot


class Poses(NamedTuple):
    handle: Array
    x_m: Array
    y_m: Array
    heading_rad: Array


def traffic(count: int, seed: int, extent_m: float = 400.0) -> Snapshot:
    rng = np.random.default_rng(seed)
    return Snapshot(
        handle=np.sort(rng.choice(1000, size=count, replace=False)).astype(np.int64),
        x_m=rng.uniform(0, extent_m, count),
        y_m=rng.uniform(0, extent_m / 8, count),
        heading_rad=rng.uniform(-math.pi, math.pi, count),
        speed_mps=rng.uniform(0, 40, count),
        lane=rng.integers(-1, 5, count).astype(np.int32),
        lane_position_m=rng.uniform(0, 100, count),
        length_m=rng.uniform(3, 18, count),
        width_m=rng.uniform(1.6, 2.6, count),
        height_m=rng.uniform(1.4, 4, count),
    )


def drivers(snapshot: Snapshot, every: int = 3) -> Poses:
    """Every third vehicle, its centre of gravity 1.6 m behind the bumper."""
    x, y, heading = snapshot.x_m[::every], snapshot.y_m[::every], snapshot.heading_rad[::every]
    return Poses(snapshot.handle[::every], x - 1.6 * np.cos(heading), y - 1.6 * np.sin(heading), heading)


def one_by_one(ego: Poses, i: int, snapshot: Snapshot, reach_m: float, most: int) -> list[tuple[float, ...]]:
    found = []
    for k in range(len(snapshot.handle)):
        if snapshot.handle[k] == ego.handle[i]:
            continue
        back = complex(math.cos(snapshot.heading_rad[k]), math.sin(snapshot.heading_rad[k]))
        centre = complex(snapshot.x_m[k], snapshot.y_m[k]) - snapshot.length_m[k] / 2 * back
        relative = (centre - complex(ego.x_m[i], ego.y_m[i])) * np.exp(-1j * ego.heading_rad[i])
        turn = math.remainder(snapshot.heading_rad[k] - ego.heading_rad[i], 2 * math.pi)
        if abs(relative) <= reach_m:
            row = (float(snapshot.handle[k]), relative.real, relative.imag, turn)
            found.append((abs(relative), *row, snapshot.speed_mps[k], snapshot.length_m[k]))
    return [row[1:] for row in sorted(found)[:most]]


@given(st.integers(0, 60), st.integers(0, 2**32 - 1), st.integers(1, 12), st.floats(5, 300))
@settings(max_examples=40)
def test_as_one_vehicle_at_a_time(count: int, seed: int, most: int, reach_m: float) -> None:
    snapshot = traffic(count, seed)
    ego = drivers(snapshot)
    objects = objects_around(ego, snapshot, reach_m, most)
    assert objects.handle.shape == (len(ego.handle), most)
    assert objects.handle.dtype == np.int64
    for i in range(len(ego.handle)):
        expected = one_by_one(ego, i, snapshot, reach_m, most)
        columns = (
            objects.handle,
            objects.forward_m,
            objects.left_m,
            objects.heading_rad,
            objects.speed_mps,
            objects.length_m,
        )
        rows = [tuple(float(column[i, k]) for column in columns) for k in range(len(expected))]
        for row, wanted in zip(rows, expected, strict=True):
            assert row == pytest.approx(wanted, abs=1e-9)
        assert (objects.handle[i, len(expected) :] == -1).all()
        assert all(np.isnan(column[i, len(expected) :]).all() for column in objects[1:])


def test_the_car_ahead_in_the_left_lane() -> None:
    one = traffic(2, 0)._replace(
        handle=np.array([4, 9]),
        x_m=np.array([10.0, 10.0 + 3.5]),
        y_m=np.array([0.0, 40.0]),
        heading_rad=np.full(2, math.pi / 2),
        length_m=np.array([4.2, 5.0]),
    )
    ego = Poses(np.array([4]), np.array([10.0]), np.array([-1.6]), np.array([math.pi / 2]))
    objects = objects_around(ego, one, 200.0, 4)
    assert list(objects.handle[0]) == [9, -1, -1, -1]
    assert objects.forward_m[0, 0] == pytest.approx(40.0 - 2.5 + 1.6)
    assert objects.left_m[0, 0] == pytest.approx(-3.5)  # further east when driving north: right
    assert objects.heading_rad[0, 0] == pytest.approx(0.0)


def test_the_fleets_order_and_slicing_change_nothing() -> None:
    snapshot = traffic(80, 5)
    ego = drivers(snapshot, 2)
    whole = objects_around(ego, snapshot, 150.0, 8)
    order = np.random.default_rng(1).permutation(len(ego.handle))
    shuffled = objects_around(select(ego, order), snapshot, 150.0, 8)
    rows = np.random.default_rng(2).permutation(len(snapshot.handle))
    mixed = objects_around(ego, select(snapshot, rows), 150.0, 8)
    part = objects_around(select(ego, slice(3, 9)), snapshot, 150.0, 8)
    for a, b, c, d in zip(whole, shuffled, mixed, part, strict=True):
        np.testing.assert_array_equal(a[order], b)
        np.testing.assert_array_equal(a, c)
        np.testing.assert_array_equal(a[3:9], d)


def test_equal_distances_are_in_order_of_handles() -> None:
    snapshot = traffic(3, 0)._replace(
        handle=np.array([7, 3, 5]),
        x_m=np.array([10.0, -10.0, 0.0]),
        y_m=np.zeros(3),
        heading_rad=np.full(3, math.pi / 2),
        length_m=np.full(3, 4.0),
    )
    ego = Poses(np.array([5]), np.zeros(1), np.zeros(1), np.zeros(1))
    assert list(objects_around(ego, snapshot, 50.0, 2).handle[0]) == [3, 7]


def test_a_lost_ego_and_an_empty_road_see_nothing() -> None:
    snapshot = traffic(10, 2)
    lost = Poses(np.array([1000, 1001]), np.array([np.nan, 5.0]), np.array([np.nan, 5.0]), np.zeros(2))
    objects = objects_around(lost, snapshot, 400.0, 5)
    assert (objects.handle[0] == -1).all()
    assert (objects.handle[1] >= 0).all()
    nothing: Objects = objects_around(lost, traffic(0, 0), 400.0, 5)
    assert (nothing.handle == -1).all()
    nobody = objects_around(select(lost, slice(0, 0)), snapshot, 400.0, 5)
    assert nobody.handle.shape == (0, 5)
