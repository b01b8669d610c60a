"""Field of view, occlusion and nearest points against rays one by one, range rates against differences."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from radar_synth.radar import LONG_RANGE, MID_RANGE, Beam, OwnMotion, Radar, Sightings
from radar_synth.visibility import objects_in_view, sightings
from sumo_net.batch import select
from sumo_net.roadside import RoadsideTable
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import Objects
from tests.roads import objects_at

WIDE = Radar(beams=(Beam(half_angle_rad=1.2, range_m=300.0),), minimum_range_m=0.05)


def at_rest(n: int) -> OwnMotion:
    return OwnMotion(np.zeros(n), np.zeros(n), np.zeros(n))


def sight(radar: Radar, *bodies: dict[str, float]) -> Sightings:
    return sightings(radar, objects_at([bodies], max(len(bodies), 1)), at_rest(1))


def corners(objects: Objects, m: int, radar: Radar) -> np.ndarray:
    h, w, psi = (
        objects.length_m[0, m] / 2,
        objects.width_m[0, m] / 2,
        objects.heading_rad[0, m],
    )
    box = np.array([h + 1j * w, -h + 1j * w, -h - 1j * w, h - 1j * w]) * np.exp(1j * psi)
    return (
        box
        + objects.forward_m[0, m]
        - radar.mount_forward_m
        + 1j * (objects.left_m[0, m] - radar.mount_left_m)
    )


def cast(objects: Objects, angles: np.ndarray, radar: Radar) -> np.ndarray:
    """(angles, bodies) distance at which each ray meets each box, inf where it misses."""
    out = np.full((len(angles), objects.handle.shape[1]), np.inf)
    for m in np.flatnonzero(objects.handle[0] != -1):
        ring = corners(objects, m, radar)
        for a, b in zip(ring, np.roll(ring, -1), strict=True):
            u, d = np.exp(1j * angles), b - a
            cross = (u.conjugate() * d).imag
            r, t = (a.conjugate() * d).imag / cross, (a.conjugate() * u).imag / cross
            hit = (r > 0) & (t >= 0) & (t <= 1)
            out[:, m] = np.where(hit, np.minimum(out[:, m], r), out[:, m])
    return out


@st.composite
def scenes(draw: Any) -> Objects:
    """Up to seven disjoint boxes in front of the radar."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bodies: list[dict[str, float]] = []
    places: list[tuple[float, float, float]] = []
    for _ in range(rng.integers(1, 25)):
        length, width = rng.uniform(0.5, 16.0), rng.uniform(0.4, 3.0)
        size = math.hypot(length, width) / 2
        x, y = rng.uniform(4.0, 120.0), rng.uniform(-25.0, 25.0)
        if (
            len(bodies) < 7
            and all(math.hypot(x - a, y - b) > size + s for a, b, s in places)
            and x > size + 2.0
        ):
            places.append((x, y, size))
            heading = rng.uniform(-math.pi, math.pi)
            bodies.append(
                {"forward_m": x, "left_m": y, "length_m": length, "width_m": width, "heading_rad": heading}
            )
    return objects_at([bodies], 8)


@given(scenes())
@settings(max_examples=60)
def test_as_many_rays_one_by_one(objects: Objects) -> None:
    step = 2e-4
    angles = np.arange(-1.2, 1.2, step)
    distance = cast(objects, angles, WIDE)
    first = np.where(np.isfinite(distance.min(axis=1)), distance.argmin(axis=1), -1)
    seen = sightings(WIDE, objects, at_rest(1))
    for m in np.flatnonzero(objects.handle[0] != -1):
        mine = first == m
        if not mine.any():
            assert np.isnan(seen.share[0, m]) or seen.share[0, m] * 1.0 < 0.2
            assert np.isnan(seen.width_m[0, m]) or seen.width_m[0, m] / seen.range_m[0, m] < 2.1 * step
            continue
        if np.isnan(seen.range_m[0, m]):
            assert mine.sum() <= 2
            continue
        # Between two rays the point may be a little nearer; edges of what is hidden fall between rays too.
        at = np.argmin(np.abs(angles - seen.azimuth_rad[0, m]))
        steepest = (
            2.0 * step * np.max(np.abs(np.diff(distance[mine, m]))) / step + 0.05 if mine.sum() > 1 else 1.0
        )
        assert seen.range_m[0, m] <= distance[mine, m].min() + 1e-9
        assert seen.range_m[0, m] >= distance[mine, m].min() - steepest
        assert m in first[max(at - 2, 0) : at + 3]
        width = mine.sum() * step
        assert seen.width_m[0, m] == pytest.approx(
            seen.range_m[0, m] * width, abs=16 * step * seen.range_m[0, m]
        )
        whole = np.isfinite(distance[:, m]).sum() * step
        if not (np.isfinite(distance[0, m]) or np.isfinite(distance[-1, m])):
            assert seen.share[0, m] == pytest.approx(width / whole, abs=20 * step / whole)


def test_rear_of_a_leader_by_hand() -> None:
    seen = sight(Radar(), {"forward_m": 1.6 + 30.0 + 2.3, "left_m": 0.4, "speed_mps": 20.0})
    assert seen.range_m[0, 0] == pytest.approx(30.0)  # the rear face is wider than the offset
    assert seen.azimuth_rad[0, 0] == pytest.approx(0.0)
    assert seen.range_rate_mps[0, 0] == pytest.approx(20.0)
    assert seen.share[0, 0] == pytest.approx(1.0)
    aside = sight(Radar(), {"forward_m": 1.6 + 30.0 + 2.3, "left_m": 3.75})
    assert aside.range_m[0, 0] == pytest.approx(math.hypot(30.0, 3.75 - 0.9))
    assert aside.azimuth_rad[0, 0] == pytest.approx(math.atan2(3.75 - 0.9, 30.0))


def test_a_lorry_hides_what_drives_before_it() -> None:
    lorry = {"forward_m": 40.0, "left_m": 0.0, "length_m": 14.0, "width_m": 2.5, "height_m": 3.8}
    hidden = {"forward_m": 70.0, "left_m": 0.0}
    beside = {"forward_m": 70.0, "left_m": 2.4}
    seen = sight(Radar(), lorry, hidden)
    assert np.isfinite(seen.range_m[0, 0])
    assert np.isnan(seen.range_m[0, 1])
    partly = sight(Radar(), beside, lorry)
    assert 0.1 < partly.share[0, 0] < 0.9
    # The ray past the lorry's rear left corner, (31.4, 1.25), meets the rear face at x = 66.1.
    rear = 70.0 - 2.3 - 1.6
    edge = rear * 1.25 / (40.0 - 7.0 - 1.6)
    assert partly.range_m[0, 0] == pytest.approx(math.hypot(rear, edge))
    assert partly.azimuth_rad[0, 0] == pytest.approx(math.atan2(edge, rear))


def test_field_of_view() -> None:
    far = sight(Radar(), {"forward_m": 195.0, "left_m": 20.0}, {"forward_m": 150.0, "left_m": 40.0})
    assert np.isfinite(far.range_m[0, 0])
    assert np.isnan(far.range_m[0, 1])  # beyond 60 m only 10 degrees to each side
    near = sight(Radar(), {"forward_m": 40.0, "left_m": 30.0}, {"forward_m": 20.0, "left_m": 30.0})
    assert np.isfinite(near.range_m[0, 0])
    assert np.isnan(near.range_m[0, 1])
    # A body that only reaches into the sector is seen where it does, at the sector's edge.
    wall = {"forward_m": 100.0, "left_m": 0.0, "length_m": 160.0, "width_m": 1.0, "heading_rad": 0.0}
    narrow = Radar(beams=(LONG_RANGE,))
    seen = sight(narrow, wall | {"left_m": 8.0})
    assert abs(seen.azimuth_rad[0, 0]) == pytest.approx(math.radians(10.0))
    assert seen.range_m[0, 0] == pytest.approx(7.5 / math.sin(math.radians(10.0)))
    assert np.isnan(sight(Radar(beams=(MID_RANGE,)), {"forward_m": 70.0, "left_m": 0.0}).range_m[0, 0])


def test_posts_hide_nothing_and_the_nearest_are_blind_spots() -> None:
    post = {"forward_m": 20.0, "left_m": 0.0, "length_m": 0.12, "width_m": 0.12}
    seen = sight(Radar(), post, {"forward_m": 60.0, "left_m": 0.0})
    assert seen.share[0].tolist() == pytest.approx([1.0, 1.0])
    assert np.isnan(sight(Radar(), {"forward_m": 1.6 + 0.3 + 2.3, "left_m": 0.0}).range_m[0, 0])


def test_second_reflection_lies_along_a_long_body() -> None:
    lorry = {"forward_m": 50.0, "left_m": 0.0, "length_m": 14.0, "width_m": 2.5}
    seen = sight(Radar(), lorry)
    assert seen.range_m[0, 0] == pytest.approx(50.0 - 7.0 - 1.6)
    assert seen.second_range_m[0, 0] == pytest.approx(50.0 - 7.0 - 1.6 + 7.0)
    assert np.isnan(sight(Radar(), lorry | {"length_m": 5.0}).second_range_m[0, 0])
    oncoming = sight(Radar(), lorry | {"heading_rad": math.pi, "left_m": 7.0})
    assert oncoming.second_range_m[0, 0] > oncoming.range_m[0, 0] + 6.0
    places = []  # on the body, while it is passed and its rear slides out of the field of view
    for forward in np.arange(14.0, 8.0, -0.5):
        seen = sight(Radar(), lorry | {"forward_m": float(forward), "left_m": -3.8})
        r, azimuth = seen.second_range_m[0, 0], seen.second_azimuth_rad[0, 0]
        places.append(1.6 + r * math.cos(azimuth) - forward)
    assert places == pytest.approx([0.0] * len(places), abs=1e-9)
    partly = sight(Radar(), lorry, {"forward_m": 38.0, "left_m": 0.0, "width_m": 1.0, "length_m": 2.0})
    assert np.isfinite(partly.range_m[0, 0])  # the lorry's edges show
    assert np.isnan(partly.second_range_m[0, 0]) or abs(partly.second_azimuth_rad[0, 0]) > 0.5 / 35.4


@given(
    st.floats(-0.4, 0.4),
    st.floats(-3.0, 3.0),
    st.floats(-10.0, 40.0),
    st.floats(-3.0, 3.0),
    st.floats(-1.0, 1.0),
)
@example(0.0, 0.0, 27.0, 1.8227880276524715, -0.2265625)
@settings(max_examples=60)
def test_range_rate_is_the_derivative_of_the_range(
    yaw_rate: float, lateral: float, speed: float, heading: float, mount_left: float
) -> None:
    """The vehicle turns and slides; the body drives along its own heading."""
    radar = (
        WIDE if mount_left == 0.0 else Radar(beams=WIDE.beams, mount_left_m=mount_left, minimum_range_m=0.05)
    )
    v = 27.0

    def at(t: float) -> Sightings:
        h = yaw_rate * t
        # Centre of gravity in world axes that are the vehicle's at t = 0: second order, the rest cancels.
        ego = complex(v * t - lateral * yaw_rate * t * t / 2, lateral * t + v * yaw_rate * t * t / 2)
        body = complex(35.0, 6.0) + speed * t * np.exp(1j * heading)
        q = (body - ego) * np.exp(-1j * h)
        objects = objects_at(
            [[{"forward_m": q.real, "left_m": q.imag, "heading_rad": heading - h, "speed_mps": speed}]], 1
        )
        return sightings(radar, objects, OwnMotion(np.array([v]), np.array([lateral]), np.array([yaw_rate])))

    now, dt = at(0.0), 1e-6
    # to either side: where another side of the body comes into view, its nearest point begins to wander
    numeric = [(at(t).range_m[0, 0] - now.range_m[0, 0]) / t for t in (-dt, dt)]
    assert min(abs(now.range_rate_mps[0, 0] - numeric)) < 1e-4


@given(scenes())
@settings(max_examples=20)
def test_mirrored_scene(objects: Objects) -> None:
    mirrored = objects._replace(left_m=-objects.left_m, heading_rad=-objects.heading_rad)
    motion = OwnMotion(np.array([25.0]), np.array([0.6]), np.array([0.1]))
    back = OwnMotion(np.array([25.0]), np.array([-0.6]), np.array([-0.1]))
    a, b = sightings(Radar(), objects, motion), sightings(Radar(), mirrored, back)
    for name in ("range_m", "range_rate_mps", "width_m", "share"):
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-9)
    np.testing.assert_allclose(a.azimuth_rad, -b.azimuth_rad, atol=1e-9)


def world(count: int, seed: int) -> Snapshot:
    rng = np.random.default_rng(seed)
    return Snapshot(
        handle=np.arange(count, dtype=np.int64),
        x_m=rng.uniform(0, 500, count),
        y_m=rng.uniform(0, 60, count),
        heading_rad=rng.choice([0.0, math.pi], count) + rng.normal(0, 0.1, count),
        speed_mps=rng.uniform(0, 40, count),
        lane=np.zeros(count, np.int32),
        lane_position_m=np.zeros(count),
        length_m=rng.uniform(3, 18, count),
        width_m=rng.uniform(1.6, 2.6, count),
        height_m=rng.uniform(1.4, 4, count),
    )


def posts(count: int, seed: int) -> RoadsideTable:
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(0, 500, count))
    size = np.full(count, 0.12)
    return RoadsideTable(
        -2 - np.arange(count), x, rng.uniform(0, 60, count), np.zeros(count), size, size, size + 1
    )


class Seers:
    def __init__(self, snapshot: Snapshot, rows: slice) -> None:
        self.handle = snapshot.handle[rows]
        self.heading_rad = snapshot.heading_rad[rows]
        self.x_m = snapshot.x_m[rows] - 1.6 * np.cos(self.heading_rad)
        self.y_m = snapshot.y_m[rows] - 1.6 * np.sin(self.heading_rad)


def test_all_that_reaches_into_view_is_gathered_nearest_first() -> None:
    snapshot, roadside = world(120, 3), posts(60, 4)
    poses = Seers(snapshot, slice(0, 120, 5))
    radar = Radar(most_objects=200)
    some = objects_in_view(radar, poses, snapshot, roadside)
    everything = objects_in_view(
        Radar(most_objects=200, beams=(Beam(half_angle_rad=1.4, range_m=500.0),)), poses, snapshot, roadside
    )
    n = len(poses.handle)
    assert some.handle.shape[0] == n
    assert (some.handle != poses.handle[:, None]).all()
    distance = np.hypot(some.forward_m, some.left_m)
    assert (np.diff(distance, axis=1)[~np.isnan(np.diff(distance, axis=1))] >= 0).all()
    a, b = sightings(radar, some, at_rest(n)), sightings(radar, everything, at_rest(n))
    for i in range(n):
        few = dict(zip(some.handle[i].tolist(), a.range_m[i].tolist(), strict=True))
        many = dict(zip(everything.handle[i].tolist(), b.range_m[i].tolist(), strict=True))
        seen = {handle for handle, r in many.items() if np.isfinite(r)}
        assert seen == {handle for handle, r in few.items() if np.isfinite(r)}
        assert {handle: few[handle] for handle in seen} == pytest.approx(
            {handle: many[handle] for handle in seen}
        )


def test_gathering_by_hand_and_in_slices() -> None:
    snapshot = world(3, 0)._replace(
        x_m=np.array([0.0, 50.0, -50.0]),
        y_m=np.array([0.0, 3.75, 0.0]),
        heading_rad=np.array([0.0, 0.2, 0.0]),
        length_m=np.array([4.2, 5.0, 4.0]),
    )
    roadside = RoadsideTable(
        np.array([-2]),
        np.array([30.0]),
        np.array([-5.0]),
        np.array([0.1]),
        *(np.array([v]) for v in (0.1, 0.1, 1.0)),
    )
    objects = objects_in_view(Radar(), Seers(snapshot, slice(0, 1)), snapshot, roadside)
    assert objects.handle[0].tolist() == [-2, 1]
    assert objects.forward_m[0].tolist() == pytest.approx([31.6, 50.0 - 2.5 * math.cos(0.2) + 1.6])
    assert objects.left_m[0].tolist() == pytest.approx([-5.0, 3.75 - 2.5 * math.sin(0.2)])
    assert objects.heading_rad[0].tolist() == pytest.approx([0.1, 0.2])
    crowd = world(80, 9)
    whole = objects_in_view(Radar(), Seers(crowd, slice(0, 80)), crowd)
    part = objects_in_view(Radar(), Seers(crowd, slice(20, 50)), crowd)
    width = part.handle.shape[1]
    for a, b in zip(select(whole, slice(20, 50)), part, strict=True):
        np.testing.assert_array_equal(a[:, :width], b)
    nobody = objects_in_view(Radar(), Seers(crowd, slice(0, 0)), crowd)
    assert sightings(Radar(), nobody, at_rest(0)).range_m.shape[0] == 0
