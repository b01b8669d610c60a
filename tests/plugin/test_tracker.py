"""The tracker: one set of tests that every filter passes, then its rules one by one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from radar_scene import Scan, Scene

from plugin.tracking import classification_kernels
from plugin.tracking.detections import Detections, Estimate, at_rest, sensor_motion
from plugin.tracking.filters import FILTERS, FilterSettings, make
from plugin.tracking.tracker import Tracker, TrackerSettings
from sumo_net.batch import select

# A leader, an oncoming car, a post ahead on the left, a car standing on the right, a slower car left.
POSITION = np.array([[[60.0, 0.0], [190.0, 5.0], [110.0, 8.0], [90.0, -6.0], [70.0, 3.75]]])
VELOCITY = np.array([[[25.0, 0.0], [-25.0, 0.0], [0.0, 0.0], [0.0, 0.0], [20.0, 0.0]]])
CLASSES = [
    classification_kernels.SAME_DIRECTION,
    classification_kernels.ONCOMING,
    classification_kernels.STATIONARY,
    classification_kernels.STATIONARY,
    classification_kernels.SAME_DIRECTION,
]


def follow(tracker: Tracker, scans: list[Scan]):  # type: ignore[no-untyped-def]
    """The tracker's lists over all scans, and the last state."""
    state, lists = tracker.init(len(scans[0].ego.speed_mps)), []
    for scan in scans:
        state, tracks = tracker.step(state, scan.detections, scan.ego, scan.dt)
        lists.append(tracks)
    return lists, state


def detections(rows: list[tuple[float, float, float]], label: list[int] | None = None) -> Detections:
    """Of one vehicle."""
    z = np.array(rows, np.float64).reshape(-1, 3)
    labels = np.array(label if label is not None else [-1] * len(z), np.int64)
    return Detections(np.zeros(len(z), np.int64), *np.ascontiguousarray(z.T), labels)


@pytest.mark.parametrize("yaw_rate", [0.0, 0.08, -0.08])
@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_follows_and_classifies_all_objects(name: str, yaw_rate: float) -> None:
    scene = Scene(POSITION, VELOCITY, yaw_rate=yaw_rate, detection=0.95)
    scans = list(scene.scans(np.random.default_rng(5), [0.1] * 25))
    lists, _ = follow(Tracker(TrackerSettings(filter=name)), scans)
    errors, right, ids = [], [], {}
    for scan, tracks in zip(scans[8:], lists[8:], strict=True):
        assert tracks.confirmed.sum() <= 5 + tracks.restarts.any()  # the published form may lose a track
        taken = np.flatnonzero(tracks.confirmed & (tracks.detection >= 0))
        body = scan.source[tracks.detection[taken]]
        estimate = select(tracks.estimate, taken)
        errors.append(
            np.stack(
                [
                    estimate.range_m - scan.polar[0, body, 0],
                    estimate.range_rate_mps - scan.polar[0, body, 1],
                    50.0 * (estimate.azimuth_rad - scan.polar[0, body, 2]),
                    estimate.vx_mps - scan.velocity[0, body, 0],
                    estimate.vy_mps - scan.velocity[0, body, 1],
                ]
            )
        )
        right += list(tracks.motion_state[taken] == np.array(CLASSES)[body])
        for b, i in zip(body, tracks.track_id[taken], strict=True):
            ids.setdefault(int(b), set()).add(int(i))
    rms = np.sqrt(np.mean(np.concatenate(errors, axis=1) ** 2, axis=1))
    assert sorted(ids) == [0, 1, 2, 3, 4]
    if name == "patent":  # as published it is far worse; it must only keep its tracks
        assert np.median(np.abs(np.concatenate(errors, axis=1)), axis=1)[0] < 2.0
        return
    assert all(len(of_body) == 1 for of_body in ids.values())
    assert (rms < [0.6, 0.45, 0.2, 0.6, 1.2]).all(), rms
    assert np.mean(right) > 0.98


@pytest.mark.parametrize("name", [name for name in FILTERS if name != "patent"])
def test_standing_objects_stand_also_from_a_braking_and_turning_vehicle(name: str) -> None:
    """Without noise the ego's motion is removed almost wholly: posts keep still over ground."""
    standing = np.array([[[50.0, 6.0], [80.0, -8.0], [120.0, 0.0]]])
    scene = Scene(standing, np.zeros_like(standing), ego_acceleration=-4.0, yaw_rate=0.1, noise=0.0)
    lists, _ = follow(
        Tracker(TrackerSettings(filter=name)), list(scene.scans(np.random.default_rng(1), [0.1] * 15))
    )
    last = lists[-1]
    assert len(last.owner) == 3
    np.testing.assert_allclose(last.estimate.vx_mps, 0.0, atol=0.1)
    np.testing.assert_allclose(last.estimate.vy_mps, 0.0, atol=0.25)
    np.testing.assert_allclose(last.estimate.ax_mps2, 0.0, atol=0.3)


@pytest.mark.parametrize("name", FILTERS)
def test_a_filter_alone_predicts_a_passing_post_to_centimetres(name: str) -> None:
    """Half a second on from exact knowledge, past an object that stands at the roadside."""
    scene = Scene(np.array([[[45.0, 6.0]]]), np.zeros((1, 1, 2)), noise=0.0, yaw_rate=0.05)
    scans = list(scene.scans(np.random.default_rng(0), [0.1] * 6))
    chosen, owner = make(name, FilterSettings()), np.zeros(1, np.int64)
    state = chosen.start(scans[0].detections, sensor_motion(scans[0].ego, 0.0))
    for scan in scans[1:]:
        sensor = sensor_motion(scan.ego, 0.0)
        state, _ = chosen.predict(state, owner, owner, np.full(1, scan.dt), sensor, 0)
    estimate = Estimate(*chosen.estimate(state, owner, sensor))
    # The start takes the unknown lateral speed as none in the axes of then, which is true of a post.
    np.testing.assert_allclose(estimate.range_m, scans[-1].polar[0, :, 0], atol=0.05)
    np.testing.assert_allclose(estimate.azimuth_rad, scans[-1].polar[0, :, 2], atol=0.004)
    np.testing.assert_allclose(estimate.range_rate_mps, scans[-1].polar[0, :, 1], atol=0.1)


@pytest.mark.parametrize("name", FILTERS)
def test_steps_may_be_irregular_and_detections_few(name: str) -> None:
    rng = np.random.default_rng(9)
    dts = list(rng.choice([0.03, 0.05, 0.1, 0.25], 60))
    scene = Scene(POSITION, VELOCITY, detection=0.7, clutter=1.0)
    lists, _ = follow(Tracker(TrackerSettings(filter=name)), list(scene.scans(rng, dts)))
    for tracks in lists:
        for part in tracks.estimate[:-1]:
            assert np.isfinite(part).all()
    if name != "patent":
        assert [int(tracks.confirmed.sum()) for tracks in lists[10:23]] == [
            5
        ] * 13  # until the first is passed


@pytest.mark.parametrize("name", FILTERS)
def test_each_vehicle_is_tracked_as_if_alone(name: str) -> None:
    """The same bytes in a fleet of three as for one, and in any order of the detections."""
    rng = np.random.default_rng(3)
    position = np.repeat(POSITION, 3, axis=0) + rng.uniform(-4, 4, (3, 5, 2))
    scans = list(
        Scene(position, np.repeat(VELOCITY, 3, axis=0), detection=0.9, clutter=3.0).scans(rng, [0.1] * 15)
    )
    tracker = Tracker(TrackerSettings(filter=name))
    together, _ = follow(tracker, scans)
    for v in range(3):
        state = tracker.init(1)
        for scan, whole in zip(scans, together, strict=True):
            mine = np.flatnonzero(scan.detections.owner == v)
            own = select(scan.detections, mine)._replace(owner=np.zeros(len(mine), np.int64))
            state, alone = tracker.step(state, own, select(scan.ego, slice(v, v + 1)), scan.dt)
            part = np.flatnonzero(whole.owner == v)
            np.testing.assert_array_equal(alone.track_id, whole.track_id[part])
            np.testing.assert_array_equal(alone.motion_state, whole.motion_state[part])
            for ours, theirs in zip(alone.estimate, whole.estimate, strict=True):
                np.testing.assert_array_equal(ours, theirs[part])


def test_two_of_five_are_not_confirmed_and_three_are() -> None:
    tracker, here = Tracker(TrackerSettings()), detections([(50.0, 0.0, 0.0)])
    for pattern, confirmed in (("11000", False), ("10101", True), ("110001", False), ("111", True)):
        state = tracker.init(1)
        for hit in pattern:
            found = here if hit == "1" else detections([])
            state, tracks = tracker.step(state, found, at_rest(1), 0.1)
        assert tracks.confirmed.any() == confirmed, pattern
    assert len(tracks.owner) == 1


def test_a_confirmed_track_coasts_and_then_ends_and_its_id_is_not_used_again() -> None:
    tracker = Tracker(TrackerSettings(coast_s=0.5))
    state = tracker.init(1)
    lives = []
    for k in range(20):
        found = detections([(50.0 - k, -10.0, 0.0)] if k < 5 or k >= 15 else [])
        state, tracks = tracker.step(state, found, at_rest(1), 0.1)
        lives.append((tracks.track_id.tolist(), tracks.detection.tolist()))
    assert lives[4] == ([0], [0])
    assert lives[9] == ([0], [-1])
    assert lives[10] == ([], [])
    assert lives[19] == ([1], [0])


def test_a_tentative_track_ends_once_it_can_no_longer_be_confirmed() -> None:
    tracker, state, alive = Tracker(TrackerSettings(coast_s=5.0)), None, []
    state = tracker.init(1)
    for hit in "10001":
        found = detections([(50.0, 0.0, 0.0)] if hit == "1" else [])
        state, tracks = tracker.step(state, found, at_rest(1), 0.1)
        alive.append(tracks.track_id.tolist())
    assert alive == [[0], [0], [0], [], [1]]  # 3 of 5 cannot be reached after the third miss


@pytest.mark.parametrize(
    ("limit", "rate_mps"),
    [({"nearest_m": 48.0}, -10.0), ({"furthest_m": 52.0}, 10.0), ({"fastest_mps": 9.0}, 10.0)],
)
def test_a_track_out_of_bounds_ends(limit: dict[str, float], rate_mps: float) -> None:
    last = {}
    for name, options in (("kept", TrackerSettings()), ("ended", TrackerSettings(**limit))):
        tracker = Tracker(options)
        state = tracker.init(1)
        for k in range(6):
            found = detections([(50.0 + 0.1 * k * rate_mps, rate_mps, 0.0)])
            state, tracks = tracker.step(state, found, at_rest(1), 0.1)
        last[name] = tracks.track_id.tolist()
    assert last["kept"] == [0]
    assert last["ended"] != [0]


def test_a_gap_of_seconds_ends_all_tracks_of_that_vehicle_only() -> None:
    tracker, here = Tracker(TrackerSettings()), detections([(50.0, 0.0, 0.0), (50.0, 0.0, 0.0)])
    both = here._replace(owner=np.array([0, 1]))
    state = tracker.init(2)
    for _ in range(4):
        state, _ = tracker.step(state, both, at_rest(2), 0.1)
    state, tracks = tracker.step(state, both, at_rest(2), np.array([0.1, 3.0]))
    assert tracks.track_id.tolist() == [0, 1]
    assert tracks.confirmed.tolist() == [True, False]


@pytest.mark.parametrize("name", FILTERS)
def test_a_target_that_jumps_ends_and_starts_anew(name: str) -> None:
    tracker = Tracker(TrackerSettings(filter=name))
    for label in ([-1], [7]):
        state = tracker.init(1)
        for k in range(20):
            r = 50.0 if k < 10 else 120.0
            state, tracks = tracker.step(state, detections([(r, 0.0, 0.0)], label), at_rest(1), 0.1)
            if k == 10 and label == [7]:
                assert tracks.track_id.tolist() == [1]  # at once: the label says it is the same target
        assert tracks.track_id.tolist() == [1]
        assert tracks.estimate.range_m[0] == pytest.approx(120.0, abs=1.0)
        assert tracks.label.tolist() == label


def test_given_targets_are_never_exchanged() -> None:
    """Two labelled targets that cross in range keep their labels; a third without label does not mix in."""
    tracker, state = Tracker(TrackerSettings()), None
    state = tracker.init(1)
    for k in range(40):
        rows = [(40.0 + 0.5 * k, 5.0, 0.0), (60.0 - 0.5 * k, -5.0, 0.001), (50.0, 0.0, 0.0)]
        state, tracks = tracker.step(state, detections(rows, [4, 9, -1]), at_rest(1), 0.1)
        if k == 0:
            assert tracks.confirmed.tolist() == [True, True, False]  # a label needs no confirmation
    np.testing.assert_allclose(tracks.estimate.range_m[tracks.label == 4], 59.5, atol=0.5)
    np.testing.assert_allclose(tracks.estimate.range_m[tracks.label == 9], 40.5, atol=0.5)
    assert sorted(tracks.label.tolist()) == [-1, 4, 9]
    assert sorted(tracks.track_id.tolist()) == [0, 1, 2]


def test_a_second_point_of_one_body_begins_no_track() -> None:
    tracker = Tracker(TrackerSettings())
    state = tracker.init(1)
    for k in range(10):
        rows = [(50.0, 0.0, 0.0)] if k < 5 else [(50.0, 0.0, 0.0), (51.0, 0.1, 0.002)]
        state, tracks = tracker.step(state, detections(rows), at_rest(1), 0.1)
    assert len(tracks.owner) == 1


def test_beside_a_tentative_track_another_one_may_begin() -> None:
    tracker = Tracker(TrackerSettings())
    state, _ = tracker.step(tracker.init(1), detections([(50.0, 0.0, 0.0)]), at_rest(1), 0.1)
    _, tracks = tracker.step(state, detections([(50.0, 0.0, 0.0), (52.0, 0.0, 0.0)]), at_rest(1), 0.1)
    assert len(tracks.owner) == 2


def test_a_confirmed_track_is_preferred_to_a_tentative_one() -> None:
    tracker = Tracker(TrackerSettings())
    state = tracker.init(1)
    for _ in range(6):
        state, _ = tracker.step(state, detections([(50.0, 0.0, 0.0)]), at_rest(1), 0.1)
    state, tracks = tracker.step(state, detections([(50.0, 0, 0), (56.0, 0, 0)]), at_rest(1), 0.1)
    assert tracks.confirmed.tolist() == [True, False]
    _, tracks = tracker.step(state, detections([(53.5, 0.0, 0.0)]), at_rest(1), 0.1)
    assert tracks.detection.tolist() == [0, -1]


def test_vehicles_leave_and_come() -> None:
    tracker = Tracker(TrackerSettings())
    rows = detections([(50.0, 0.0, 0.0), (60.0, 0.0, 0.0), (70.0, 0.0, 0.0)])._replace(owner=np.arange(3))
    state = tracker.init(3)
    for _ in range(4):
        state, _ = tracker.step(state, rows, at_rest(3), 0.1)
    state = tracker.reindex(state, np.array([2, -1, 0]))
    assert state.tracks.owner.tolist() == [0, 2]
    swapped = rows._replace(range_m=np.array([70.0, 20.0, 50.0]))
    state, tracks = tracker.step(state, swapped, at_rest(3), 0.1)
    assert tracks.owner.tolist() == [0, 1, 2]
    assert tracks.confirmed.tolist() == [True, False, True]
    np.testing.assert_allclose(tracks.estimate.range_m, [70.0, 20.0, 50.0], atol=0.01)
    empty = tracker.reindex(state, np.zeros(0, np.int64))
    empty, tracks = tracker.step(empty, detections([]), at_rest(0), 0.1)
    assert len(tracks.owner) == 0
    assert tracker.reindex(empty, np.array([-1])).next_id.tolist() == [0]


@pytest.mark.parametrize("name", FILTERS)
def test_parts_of_a_fleet_are_tracked_like_the_whole(name: str) -> None:
    """Parted, moved on, joined again: the same numbers to the last bit."""
    tracker = Tracker(TrackerSettings(filter=name))
    rng = np.random.default_rng(4)

    def scan(step: int) -> Detections:
        owner, place = np.repeat(np.arange(5), 3), np.tile([30.0, 60.0, 90.0], 5)
        noise = rng.normal(0.0, 0.2, 15)
        still, no = np.zeros(15), np.full(15, -1, np.int64)
        seen = Detections(owner, place + noise - step, still - 10.0, still, no)
        return select(seen, rng.random(15) > 0.2)

    whole = tracker.init(5)
    for step in range(6):
        whole, _ = tracker.step(whole, scan(step), at_rest(5), 0.1)
    parts = [tracker.reindex(whole, rows) for rows in (np.array([0, 1]), np.array([2, 3, 4]))]
    for step in range(6, 12):
        seen = scan(step)
        first, last = select(seen, seen.owner < 2), select(seen, seen.owner >= 2)
        whole, tracks = tracker.step(whole, seen, at_rest(5), 0.1)
        parts[0], some = tracker.step(parts[0], first, at_rest(2), 0.1)
        parts[1], others = tracker.step(parts[1], last._replace(owner=last.owner - 2), at_rest(3), 0.1)
        if step == 8:
            joined = tracker.join(*parts)
            parts = [tracker.reindex(joined, rows) for rows in (np.array([0, 1]), np.array([2, 3, 4]))]
        for one, two, both in zip(some.estimate, others.estimate, tracks.estimate, strict=True):
            np.testing.assert_array_equal(np.concatenate([one, two]), both)
        np.testing.assert_array_equal(np.concatenate([some.track_id, others.track_id]), tracks.track_id)
        np.testing.assert_array_equal(np.concatenate([some.owner, others.owner + 2]), tracks.owner)


@pytest.mark.parametrize("name", FILTERS)
def test_vehicles_without_tracks_join_without_a_copy(name: str) -> None:
    """Covariances are large, and vehicles come in every other step."""
    tracker = Tracker(TrackerSettings(filter=name))
    seen = detections([(50.0, 0.0, 0.0), (80.0, 0.0, 0.1)])
    state, _ = tracker.step(tracker.init(1), seen, at_rest(1), 0.1)
    joined = tracker.join(tracker.init(2), state, tracker.init(1))
    assert np.shares_memory(joined.filter.P, state.filter.P)
    _, alone = tracker.step(state, seen, at_rest(1), 0.1)
    _, among = tracker.step(joined, seen._replace(owner=seen.owner + 2), at_rest(4), 0.1)
    np.testing.assert_array_equal(among.owner, alone.owner + 2)
    np.testing.assert_array_equal(among.estimate, alone.estimate)
    nobody = tracker.join(tracker.init(1), tracker.init(1))
    _, begun = tracker.step(nobody, seen, at_rest(2), 0.1)
    assert len(begun.owner) == 2


@pytest.mark.parametrize("name", FILTERS)
def test_a_track_whose_numbers_are_lost_for_good_ends(name: str) -> None:
    tracker = Tracker(TrackerSettings(filter=name))
    seen = detections([(50.0, 0.0, 0.0), (80.0, 0.0, 0.1)])
    state = tracker.init(1)
    for _ in range(4):
        state, _ = tracker.step(state, seen, at_rest(1), 0.1)
    state.filter.x[state.rows[0]] = np.nan
    _, tracks = tracker.step(state, seen, at_rest(1), 0.1)
    assert np.isfinite(tracks.estimate.range_m).all()
    assert sorted(np.round(tracks.estimate.range_m).tolist()) == [50.0, 80.0]


def test_what_the_published_form_loses_is_counted_not_hidden() -> None:
    scene = Scene(POSITION, VELOCITY)
    scans = list(scene.scans(np.random.default_rng(2), [0.1] * 20))
    lost = {name: follow(Tracker(TrackerSettings(filter=name)), scans)[0][-1].restarts for name in FILTERS}
    assert lost["patent"].sum() > 10
    assert all(not lost[name].any() for name in FILTERS if name != "patent")


@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(FILTERS))
@settings(max_examples=20)
def test_clutter_alone_breaks_nothing(seed: int, name: str) -> None:
    """Dense nonsense: ids stay unique within a vehicle, owners sorted, numbers finite."""
    rng = np.random.default_rng(seed)
    scene = Scene(np.zeros((2, 0, 2)), np.zeros((2, 0, 2)), clutter=30.0, yaw_rate=0.3)
    lists, _ = follow(Tracker(TrackerSettings(filter=name)), list(scene.scans(rng, [0.1] * 12)))
    for tracks in lists:
        assert (np.diff(tracks.owner) >= 0).all()
        for v in range(2):
            mine = tracks.track_id[tracks.owner == v]
            assert len(set(mine)) == len(mine)
        taken = tracks.detection[tracks.detection >= 0]
        assert len(set(taken)) == len(taken)
        assert all(np.isfinite(part).all() for part in tracks.estimate[:-1])


def test_input_that_is_no_number_is_refused() -> None:
    tracker = Tracker(TrackerSettings())
    with pytest.raises(ValueError, match=r"azimuth_rad\[1\] = nan"):
        tracker.step(tracker.init(1), detections([(5, 0, 0), (5, 0, np.nan)]), at_rest(1), 0.1)
    with pytest.raises(ValueError, match=r"dt_s = -0.1"):
        tracker.step(tracker.init(1), detections([]), at_rest(1), -0.1)


def test_settings_say_what_is_wrong() -> None:
    with pytest.raises(ValidationError, match="confirm_hits = 6"):
        TrackerSettings(confirm_hits=6)
    with pytest.raises(ValueError, match="allowed are imm, adaptive, patent, cv, ca"):
        make("kalman", FilterSettings())
