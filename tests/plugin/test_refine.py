"""The default lane tracker: its road model against independent geometry, and drawn frames."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendered_drive import Drive
from scipy.integrate import solve_ivp

from camera_synth.camera import Camera, image_from_vehicle, projection
from plugin.configuration import Configuration, configuration_from
from plugin.lane import lane_motion, refine, refine_fit, road_model
from plugin.lane.cholesky import invert
from plugin.lane.detector import LaneTracker
from plugin.lane.estimate import BORDER_Y
from plugin.lane.hidden import nothing_hidden
from plugin.lane.refine import Refine, init, needs_search, step
from plugin.vision import Vision
from sumo_net.batch import join, select
from sumo_net.settings import SettingsError
from sumo_net.vehicle import Vehicle

CAMERA = Camera()
P = projection(CAMERA)
SIDES = ((road_model.LEFT, 0.5), (road_model.RIGHT, -0.5))

NO_SLIP = Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0)  # for cars that are moved along their heading


def state_of(offset=0.2, heading=0.01, curvature=0.002, rate=0.0, width=3.6, phase=4.0):
    """x of a clothoid whose knots have the curvatures that it has there."""
    x = np.zeros(road_model.STATES)
    x[road_model.OFFSET], x[road_model.HEADING], x[road_model.WIDTH] = offset, heading, width
    x[road_model.NEXT_LEFT] = x[road_model.NEXT_RIGHT] = width
    stations = -phase + road_model.SPACING_M * np.arange(road_model.KNOTS)
    x[road_model.KNOT : road_model.TURN] = curvature + rate * stations
    return x


def columns(x, phase, rows, side=road_model.LEFT, p=P):
    node, out = np.zeros((road_model.NODES, 5)), np.zeros((len(rows), 6))
    ground = np.zeros((len(rows), 4))
    road_model.trace(x, phase, node)
    road_model.ground_of_rows(rows, x[road_model.PITCH], p, ground)
    road_model.border_columns(x, ground, node, p, side, 105.0, out)
    return out


@pytest.mark.parametrize(
    "camera", [Camera(), Camera(yaw_rad=0.03, forward_m=1.2, left_m=-0.3, focal_y_px=700.0)]
)
@pytest.mark.parametrize(("curvature", "rate"), [(0.0, 0.0), (1 / 250, 0.0), (-1 / 250, 6e-5), (0.0, -5e-5)])
def test_borders_match_an_integrated_clothoid(camera, curvature, rate):
    p = projection(camera)
    rows = np.arange(5.0, camera.horizon_y_px - 15, 7.0)
    x = state_of(curvature=curvature, rate=rate)
    d, e = x[road_model.OFFSET], x[road_model.HEADING]

    def along(s, pose):
        return [np.cos(pose[2]), np.sin(pose[2]), curvature + rate * s]

    stations = np.linspace(0.0, 100.0, 2001)
    start = [-d * np.sin(e), -d * np.cos(e), -e]
    forward, left, direction = solve_ivp(along, (0, 100), start, t_eval=stations, rtol=1e-9, atol=1e-9).y
    for side, half in SIDES:
        aside = half * x[road_model.WIDTH]
        points = [
            image_from_vehicle(f - aside * np.sin(a), y + aside * np.cos(a), 0.0, p)
            for f, y, a in zip(forward, left, direction, strict=True)
            if f > 5.0
        ]
        seen = np.array(points)
        wanted = np.interp(rows, seen[:, 1], seen[:, 0], left=np.nan, right=np.nan)
        found = columns(x, 4.0, rows, side, p)[:, 0]
        both = np.isfinite(wanted) & np.isfinite(found)
        assert both.sum() >= 8
        assert np.abs(found - wanted)[both].max() < 0.25


@settings(max_examples=15)
@given(st.floats(-1, 1), st.floats(-0.05, 0.05), st.floats(-0.004, 0.004), st.floats(0.0, 14.9))
def test_jacobian_is_the_derivative_of_the_columns(offset, heading, curvature, phase):
    x = state_of(offset, heading, curvature, phase=phase)
    rows = np.arange(20.0, 140.0, 15.0)
    work = refine_fit.workspace(len(rows))
    tuning = refine.tuning(Refine(), 33.5)
    road_model.bases(phase, work.first, work.area)
    refine_fit.place_borders(x, phase, rows, P, tuning, work)
    for side in range(road_model.LINES):
        for r in range(len(rows)):
            if np.isnan(work.border[side, r, 0]):
                continue
            work.J[:] = 0.0
            refine_fit.jacobian(phase, side, r, P, work)
            scale = np.abs(work.J[: road_model.KNOT]).max()
            knots = np.abs(work.J[road_model.KNOT :]).max()
            for j in range(road_model.TURN):
                h = {road_model.OFFSET: 1e-3, road_model.WIDTH: 1e-3}.get(j, 1e-6)
                moved = x.copy()
                moved[j] += h
                slope = (columns(moved, phase, rows, side)[r, 0] - work.border[side, r, 0]) / h
                # only the columns must be exact; the step's direction may be rough
                assert work.J[j] == pytest.approx(
                    slope, rel=0.06, abs=1e-2 * (knots if j >= road_model.KNOT else scale)
                )


def test_inverse_is_numpys():
    rng = np.random.default_rng(1)
    A = rng.normal(size=(15, 15))
    A = A @ A.T + np.eye(15)
    out = np.empty((15, 15))
    assert invert(A, np.empty((15, 15)), out)
    np.testing.assert_allclose(out, np.linalg.inv(A), atol=1e-10)
    assert not invert(-A, np.empty((15, 15)), out)


def test_prediction_leaves_the_road_where_it_is():
    tuning = refine.tuning(NO_SLIP, 33.5)
    x, covariance = state_of(0.3, 0.0, 0.002, 1e-5, phase=13.0), np.eye(road_model.STATES) * 1e-4
    before = road_model.curvature_at(x, 13.0, 40.0)
    phase = lane_motion.predict(x, covariance, 13.0, 3.0, tuning)
    assert phase == pytest.approx(1.0)
    assert road_model.curvature_at(x, phase, 37.0) == pytest.approx(before)
    assert x[road_model.OFFSET] == pytest.approx(0.3)
    np.testing.assert_allclose(covariance, covariance.T, atol=1e-15)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("side", [1, -1])
def test_a_shift_moves_no_line(side):
    tuning = refine.tuning(Refine(), 33.5)
    rng = np.random.default_rng(0)
    x = state_of(offset=side * 1.9)
    x[road_model.NEXT_LEFT], x[road_model.NEXT_RIGHT] = 3.4, 3.9
    A = rng.normal(size=(road_model.STATES, 40)) * 0.01
    covariance = A @ A.T
    near = road_model.NEXT_LEFT if side > 0 else road_model.NEXT_RIGHT
    shared = np.zeros(road_model.STATES)
    shared[road_model.OFFSET], shared[road_model.WIDTH] = -1.0, 0.5 * side
    variance = shared @ covariance @ shared
    rows = np.arange(60.0, 140.0, 5.0)
    lines = [columns(x, 4.0, rows, k)[:, 0] for k in range(4)]
    width = x[near]
    lane_motion.shift_lane(x, covariance, side, tuning)
    after = [columns(x, 4.0, rows, k)[:, 0] for k in range(4)]
    left, right, outer_left, outer_right = range(4)
    pairs = ((outer_left, left), (left, right), (right, outer_right))
    for one, other in pairs if side > 0 else [(b, a) for a, b in pairs]:
        np.testing.assert_allclose(after[other], lines[one], atol=0.02)
    assert x[road_model.WIDTH] == width
    # the border between both lanes is known as well as before
    shared[road_model.WIDTH] *= -1.0
    assert shared @ covariance @ shared == pytest.approx(variance)


def wander(n, k, speed, seed=0):
    """Offset and heading of cars that keep their lane at frame k."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, n)
    t = 0.1 * k
    return 0.3 * np.sin(0.5 * t + phase), np.arctan(0.15 * np.cos(0.5 * t + phase) / speed)


@pytest.mark.parametrize(
    ("condition", "curvature", "rate", "limits"),
    [
        ("clear", 0.0, 0.0, (0.03, 0.002, 2e-4)),
        ("clear", -1 / 250, 0.0, (0.03, 0.002, 2e-4)),
        ("clear", 0.0, 4e-5, (0.03, 0.002, 2e-4)),
        ("complex", 1 / 800, 0.0, (0.06, 0.004, 4e-4)),
    ],
)
def test_a_drive_is_followed_within_the_targets(condition, curvature, rate, limits):
    n, seconds = 8, 5
    drive = Drive(n, condition, curvature=curvature, rate=rate)
    state, errors, locked = init(n), [], []
    for k in range(10 * seconds):
        offset, heading = wander(n, k, drive.speed)
        bend = drive.frame(offset, heading)
        state, lane = step(drive.frames, None, None, state, P, np.full(n, drive.speed), NO_SLIP)
        locked.append(lane.locked)
        errors.append(
            [lane.lateral_offset_m - offset, lane.heading_error_rad - heading, lane.curvature_1pm - bend]
        )
    assert np.mean(locked) > (0.999 if condition == "clear" else 0.9)
    rmse = np.sqrt(np.nanmean(np.square(errors[5:]), axis=(0, 2)))
    assert (rmse < limits).all(), rmse
    # what the tracker thinks of itself is of the right size
    spread = np.sqrt(state.P[:, road_model.OFFSET, road_model.OFFSET])
    assert np.abs(errors[-1][0]).mean() < 3 * spread.mean()


def test_a_lane_change_keeps_the_lock_and_shifts_once():
    n, drive = 4, Drive(4)
    state, shifts, wrong = init(n), np.zeros(n, int), 0
    for k in range(80):
        u = np.clip((0.1 * k - 1.0) / 5.0, 0.0, 1.0)
        offset = 3.75 * (u - np.sin(2 * np.pi * u) / (2 * np.pi))
        heading = np.arctan(3.75 / 5.0 * (1 - np.cos(2 * np.pi * u)) / drive.speed)
        drive.frame(np.full(n, offset), np.full(n, heading))
        state, lane = step(drive.frames, None, None, state, P, np.full(n, drive.speed), NO_SLIP)
        assert lane.locked.all()
        shifts += lane.lane_shift
        own = offset - 3.75 * round(offset / 3.75)
        if abs(abs(own) - 1.875) > 0.1:
            wrong += int((np.abs(lane.lateral_offset_m - own) > 0.1).sum())
    assert (shifts == 1).all()
    assert wrong == 0


def test_asphalt_without_markings_is_no_lane():
    rng = np.random.default_rng(0)
    state = init(3)
    for _ in range(10):
        frames = np.clip(rng.normal(95, 6, (3, 240, 320)), 0, 255).astype(np.uint8)
        state, lane = step(frames, None, None, state, P, np.full(3, 25.0), Refine())
        assert not lane.locked.any()
        assert np.isnan(lane.lateral_offset_m).all()
        assert needs_search(state).all() or not lane.left_border_seen.any()


def test_a_lane_that_vanishes_is_given_up_and_found_again():
    n, drive, refine_settings = 2, Drive(2), Refine(patience_frames=5)
    rng = np.random.default_rng(0)
    state, locked = init(n), []
    for k in range(40):
        drive.frame(np.zeros(n), np.zeros(n))
        blank = rng.normal(98, 3, drive.frames.shape).astype(np.uint8)
        frames = blank if 10 <= k < 25 else drive.frames
        state, lane = step(frames, None, None, state, P, np.full(n, drive.speed), refine_settings)
        locked.append(lane.locked.all())
    assert all(locked[:10])
    assert not any(locked[17:25])
    assert all(locked[28:])


def test_how_far_it_is_since_paint_was_seen_near_by():
    """As before a junction: the lines beyond it are followed, those beside the car have ended."""
    n, drive = 2, Drive(2)
    rng = np.random.default_rng(0)
    state, unseen = init(n), []
    first_row = 239 - int(image_from_vehicle(32.0, 0.0, 0.0, P)[1])
    for k in range(40):
        drive.frame(np.zeros(n), np.zeros(n))
        if 20 <= k < 30:  # nothing is painted within 32 m
            near = drive.frames[:, first_row:]
            near[:] = rng.normal(98, 3, near.shape)
        state, lane = step(drive.frames, None, None, state, P, np.full(n, drive.speed), NO_SLIP)
        assert lane.locked.all()
        unseen.append([lane.left_unseen_m, lane.right_unseen_m])
    unseen = np.array(unseen)
    driven = 0.1 * drive.speed * np.arange(1, 11)
    assert unseen[20:30] == pytest.approx(np.broadcast_to(driven[:, None, None], (10, 2, n)))
    assert (unseen[30:] == 0.0).mean() > 0.9
    assert (unseen[5:20] == 0.0).mean() > 0.9


def test_a_border_behind_a_body_raises_no_doubt():
    """What is usually seen of it stays known, and the lane as well proven as it was."""
    n, drive = 2, Drive(2)
    state, hidden = init(n), nothing_hidden(n)
    for k in range(40):
        drive.frame(np.zeros(n), np.zeros(n))
        if k == 20:
            usual, proof = state.share[:, 1].copy(), state.proof.copy()
            hidden[:, 0, :3] = -100.0, 160.0, 400.0  # foot, first and last column
        # a yaw rate that no road and no line seen explains
        yaw_rate = np.full(n, 0.0 if k < 20 else 0.05)
        state, lane = step(
            drive.frames, None, None, state, P, np.full(n, drive.speed), NO_SLIP, hidden, yaw_rate
        )
    assert not lane.right_border_seen.any()
    assert lane.left_border_seen.all()
    np.testing.assert_array_equal(state.share[:, 1], usual)
    assert (state.proof >= proof).all()


def test_standstill_is_fine():
    drive, state = Drive(2), init(2)
    for _ in range(30):
        drive.frame(np.array([0.4, -0.3]), np.zeros(2))
        drive.count = 0
        state, lane = step(drive.frames, None, None, state, P, np.zeros(2), Refine())
    assert lane.lateral_offset_m == pytest.approx([0.4, -0.3], abs=0.03)


def test_a_fleet_is_its_parts():
    drive, whole = Drive(3), init(3)
    parts = [init(1) for _ in range(3)]
    speed = np.full(3, drive.speed)
    for k in range(6):
        drive.frame(*wander(3, k, drive.speed))
        whole, lane = step(drive.frames, None, None, whole, P, speed, Refine())
        done = [step(drive.frames[i : i + 1], None, None, parts[i], P, speed[:1], Refine()) for i in range(3)]
        parts = [after for after, _ in done]
        for i, (_, one) in enumerate(done):
            for part, value in zip(select(lane, slice(i, i + 1)), one, strict=True):
                np.testing.assert_array_equal(part, value)
    joined = join(join(parts[0], parts[1]), parts[2])
    for part, value in zip(joined, whole, strict=True):
        np.testing.assert_array_equal(part, value)


def test_parabolas_lie_on_the_borders():
    drive, state = Drive(1), init(1)
    for _ in range(3):
        drive.frame(np.zeros(1), np.zeros(1))
        state, _ = step(drive.frames, None, None, state, P, np.zeros(1), Refine())
    rows = np.arange(50.0, 140.0, 10.0)
    wanted = refine.border_columns(state, rows, P)[0]
    whole = BORDER_Y
    borders = refine.parabolas(state, refine.border_columns(state, whole, P), whole)
    for side, (a, b, c) in enumerate((borders.left[0], borders.right[0])):
        np.testing.assert_allclose((a * rows + b) * rows + c, wanted[side], atol=1.0)


def test_wrong_sizes_are_named():
    with pytest.raises(ValueError, match="must be uint8"):
        step(np.zeros((1, 240, 321), np.uint8), None, None, init(1), P, np.zeros(1), Refine())
    with pytest.raises(ValueError, match="lane_width_m = 9"):
        Refine(lane_width_m=9.0)


def test_the_rear_axle_is_that_of_the_vehicle() -> None:
    car = Vehicle(rear_axle_m=1.6, front_axle_m=1.2, mass_kg=2000.0, rear_stiffness_npr=90_000.0)
    found = refine.on_vehicle(Refine(), car)
    v, m, lf, lr = 30.0, car.mass_kg, car.front_axle_m, car.rear_axle_m
    kf, kr = car.front_stiffness_npr, car.rear_stiffness_npr
    # a steady turn of the single-track model: lateral forces and moments at 0.01 rad
    balance = np.array(
        [[kf + kr, lf * kf - lr * kr + m * v * v], [lf * kf - lr * kr, lf * lf * kf + lr * lr * kr]]
    )
    lateral_mps, yaw_rps = np.linalg.solve(balance / v, 0.01 * np.array([kf, lf * kf]))
    assert lateral_mps / yaw_rps == pytest.approx(found.rear_axle_m - found.rear_slip_s2pm * v * v)
    own = refine.on_vehicle(Refine(rear_axle_m=0.0, rear_slip_s2pm=0.0), car)
    assert (own.rear_axle_m, own.rear_slip_s2pm) == (0.0, 0.0)


def test_a_run_tracks_lanes_with_the_rear_axle_of_its_vehicle() -> None:
    configuration = Configuration(vehicle=Vehicle(rear_axle_m=1.6))
    detector = Vision(configuration, 1, beside=False)._detector
    assert isinstance(detector, LaneTracker)
    assert detector._settings.rear_axle_m == 1.6


def test_the_trackers_step_is_that_of_a_run() -> None:
    with pytest.raises(SettingsError, match=r"refine.step_s = 0.05: must be 0.1"):
        configuration_from({"refine": {"step_s": 0.05}})
