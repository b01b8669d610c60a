"""The ego's motion: integrator, road frame, and the fleet over paths, lane changes, arrivals and losses."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from plugin.configuration import load_configuration
from sumo_net import network
from sumo_net.batch import select
from sumo_net.driver import Driver
from sumo_net.driver_kernels import LANE_KEEPING, MICROSLEEP, SIGNALLED_CHANGE
from sumo_net.ego import Ego, EgoTruth
from sumo_net.ego_kernels import forward_speed, lateral_rates, rates, runge_kutta, sine_cosine
from sumo_net.highway import Highway
from sumo_net.road import RoadNetwork
from sumo_net.road_kernels import project
from sumo_net.scenario import prepare
from sumo_net.settings import SettingsError
from sumo_net.traffic import Snapshot, Traffic
from sumo_net.vehicle import Vehicle, derivatives, model, steady_state
from tests.sumo_net.bench_road import LORRY, QUIET, STILL

CAR = Vehicle()
P = model(CAR)
LANE_M = 3.75


# --- the integrator


@given(st.floats(-1.2, 1.2))
def test_sine_and_cosine(angle: float) -> None:
    assert sine_cosine(angle) == pytest.approx((math.sin(angle), math.cos(angle)), abs=3e-7)


@pytest.mark.parametrize("v", [0.0, 1.0, 2.5, 3.0, 5.0, 15.0, 40.0, 60.0])
def test_runge_kutta_against_scipy(v: float) -> None:
    steer_rate, curvature_rate, acceleration, T = 0.05, 2e-4, 1.5, 0.5

    def right_side(t: float, x: np.ndarray) -> tuple[float, ...]:
        return rates(*x, steer_rate * t, v + acceleration * t, curvature_rate * t, P)

    exact = solve_ivp(right_side, (0.0, T), [0.2, 0.01, 0.1, 0.02], rtol=1e-11, atol=1e-13, max_step=0.005)
    x, h = (0.2, 0.01, 0.1, 0.02), 0.01
    for j in range(50):
        a, b = j * h, (j + 1) * h
        x = runge_kutta(
            x,
            steer_rate * a,
            steer_rate * b,
            v + acceleration * a,
            v + acceleration * b,
            curvature_rate * a,
            curvature_rate * b,
            h,
            P,
        )
    assert x == pytest.approx(exact.y[:, -1], abs=2e-5 if v < 4.0 else 1e-7)


@pytest.mark.parametrize("kmh", [60.0, 80.0, 88.0, 90.0])
def test_a_held_steer_settles_in_the_checked_steady_state(kmh: float) -> None:
    v, steer = kmh / 3.6, 0.05
    x = (0.0, 0.0, 0.0, 0.0)
    for _ in range(600):
        # the path is taken anew under the car each time, so that the speed along the car's axis stays v
        x = runge_kutta((0.0, 0.0, x[2], x[3]), steer, steer, v, v, 0.0, 0.0, 0.01, P)
    assert np.array(x[2:]) == pytest.approx(steady_state(CAR, v, steer), rel=5e-4)


def test_standing_and_crawling_are_nothing_special() -> None:
    x = (0.5, 0.1, 0.3, 0.2)
    for _ in range(200):
        x = runge_kutta(x, 0.3, 0.3, 0.0, 0.0, 0.1, 0.1, 0.01, P)
    assert np.isfinite(x).all()
    assert x[2:] == pytest.approx((0.0, 0.0), abs=1e-4)
    # rolling without slip: the rear axle moves along the body
    v_y, yaw_rate = 0.0, 0.0
    for _ in range(300):
        _, _, v_y, yaw_rate = runge_kutta((0, 0, v_y, yaw_rate), 0.3, 0.3, 1.0, 1.0, 0.0, 0.0, 0.01, P)
    assert yaw_rate == pytest.approx(math.tan(0.3) / CAR.wheelbase_m, rel=1e-3)
    assert v_y == pytest.approx(CAR.rear_axle_m * yaw_rate, rel=1e-3)


@settings(max_examples=30)
@given(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1))
def test_go_over_from_rolling_to_tyres_has_no_step(v_y: float, yaw_rate: float, steer: float) -> None:
    for edge in (2.0, 4.0):
        below = lateral_rates(v_y, yaw_rate, steer, edge - 1e-9, P)
        above = lateral_rates(v_y, yaw_rate, steer, edge + 1e-9, P)
        assert below == pytest.approx(above, abs=1e-5)
    assert lateral_rates(v_y, yaw_rate, steer, 20.0, P) == derivatives(v_y, yaw_rate, steer, 20.0, P)


def test_road_frame_against_the_world_on_a_circle() -> None:
    radius, along, steer = 250.0, 25.0, 0.012
    curvature = 1.0 / radius

    def in_road(_: float, x: np.ndarray) -> list[float]:
        _s, d, e, v_y, yaw_rate, _wx, _wy, heading = x
        rate = rates(d, e, v_y, yaw_rate, steer, along, curvature, P)
        v = forward_speed(along, v_y, d, e, curvature)
        return [
            along,
            *rate,
            v * math.cos(heading) - v_y * math.sin(heading),
            v * math.sin(heading) + v_y * math.cos(heading),
            yaw_rate,
        ]

    d0, e0 = -1.5, 0.03
    start = [0.0, d0, e0, 0.0, 0.1, 0.0, d0, e0]
    s, d, e, _, _, wx, wy, heading = solve_ivp(in_road, (0, 4), start, rtol=1e-10, atol=1e-10).y[:, -1]
    angle = s / radius
    assert heading == pytest.approx(angle + e, abs=1e-8)
    assert wx == pytest.approx((radius - d) * math.sin(angle), abs=1e-4)
    assert wy == pytest.approx(radius - (radius - d) * math.cos(angle), abs=1e-4)
    assert abs(d - d0) > 1.0  # it did go somewhere


# --- the fleet, on the exact highway, with a made-up SUMO


class MadeUpTraffic:
    """Vehicles at constant speed on chosen lanes of the forward carriageway."""

    def __init__(self, built: network.BuiltNetwork, n: int, speed_mps: float, edge: int = 0) -> None:
        self.edges = built.carriageways[0].edges
        self.lane_ids = [f"{name}_{k}" for name in self.edges for k in range(3)]
        self.lengths = {}
        for lane in RoadNetwork.from_highway(built).graph.lanes.values():
            self.lengths[lane.id] = lane.length_m
        self.handle = np.arange(n, dtype=np.int64) * 7
        self.speed = np.full(n, speed_mps)
        self.edge = np.full(n, edge)
        self.index = np.arange(n) % 3
        self.position = 100.0 + 45.0 * np.arange(n, dtype=float)

    def vehicle_id(self, handle: int) -> str:
        return f"car{handle}"

    def accelerations_mps2(self, handles: np.ndarray) -> np.ndarray:
        return np.zeros(len(handles))

    def route_ahead(self, handle: int) -> tuple[str, ...]:
        return self.edges[self.edge[np.searchsorted(self.handle, handle)] :]

    def lane(self) -> np.ndarray:
        return (3 * self.edge + self.index).astype(np.int32)

    def snapshot(self) -> Snapshot:
        n = len(self.handle)
        some = np.zeros(n)
        return Snapshot(
            self.handle, some, some, some, self.speed.copy(), self.lane(), self.position.copy(),
            some + 4.3, some + 1.8, some + 1.5,
        )  # fmt: skip

    def move(self) -> Snapshot:
        self.position += 0.1 * self.speed
        for i, lane in enumerate(self.lane()):
            length = self.lengths[self.lane_ids[lane]]
            if self.position[i] > length and self.edge[i] + 1 < len(self.edges):
                self.position[i] -= length
                self.edge[i] += 1
        return self.snapshot()


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return network.build(Highway(), tmp_path_factory.mktemp("highway"))


def everyone(snapshot: Snapshot) -> np.ndarray:
    return np.ones(len(snapshot.handle), np.bool_)


def drive(ego: Ego, traffic: MadeUpTraffic, steps: int) -> list[EgoTruth]:
    truths = []
    for _ in range(steps):
        snapshot = traffic.move()
        truths.append(ego.step(snapshot, everyone(snapshot)))
    return truths


def stacked(truths: list[EgoTruth], name: str) -> np.ndarray:
    return np.array([getattr(truth, name) for truth in truths])


def test_a_vehicle_that_is_faster_than_its_driver_can_steer_is_named(built) -> None:
    traffic = MadeUpTraffic(built, 3, 24.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 3, Driver(**QUIET), LORRY)
    drive(ego, traffic, 5)
    traffic.speed[1] = 50.0
    with pytest.raises(SettingsError, match=r"vehicle 'car7' drives 50\.0 m/s: .* unstable above 40 m/s"):
        drive(ego, traffic, 1)


def test_world_pose_follows_the_reported_motion_over_paths_and_lane_changes(built) -> None:
    """No jump anywhere: the pose moves by the speeds and turns by the yaw rate that are reported."""
    traffic = MadeUpTraffic(built, 12, 30.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 3, Driver(**QUIET))
    truths = drive(ego, traffic, 300)
    traffic.index[:] = np.array([1, 2, 1] * 4)  # SUMO changes lanes, all at once
    truths += drive(ego, traffic, 300)
    assert len(set(stacked(truths, "path")[:, 0])) >= 3
    x, y, heading = (stacked(truths, name) for name in ("x_m", "y_m", "heading_rad"))
    v, v_y, yaw = (stacked(truths, name) for name in ("speed_mps", "lateral_speed_mps", "yaw_rate_rps"))
    turn = np.mod(np.diff(heading, axis=0) + math.pi, 2 * math.pi) - math.pi
    middle = heading[:-1] + 0.5 * turn
    forward = np.cos(middle) * np.diff(x, axis=0) + np.sin(middle) * np.diff(y, axis=0)
    left = np.cos(middle) * np.diff(y, axis=0) - np.sin(middle) * np.diff(x, axis=0)
    assert turn == pytest.approx(0.05 * (yaw[1:] + yaw[:-1]), abs=1e-3)
    assert left == pytest.approx(0.05 * (v_y[1:] + v_y[:-1]), abs=2e-3)
    # a lane change of SUMO's may also move the vehicle along a bend: it closes up within seconds
    assert forward == pytest.approx(0.05 * (v[1:] + v[:-1]), abs=0.05)
    gap = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    assert gap.max() < 3.2
    assert np.abs(stacked(truths, "path_offset_m")[-1]).max() < 1.0


def test_lane_change_as_the_truth_tells_it(built) -> None:
    traffic = MadeUpTraffic(built, 3, 30.0)
    traffic.index[:] = 0
    settings_ = Driver(**(STILL | {"signal_probability": 1.0, "signal_spread": 0.0}))
    ego = Ego(RoadNetwork.from_highway(built), traffic, 3, settings_)
    drive(ego, traffic, 20)
    traffic.index[:] = 1
    truths = drive(ego, traffic, 80)
    d, away = stacked(truths, "path_offset_m")[:, 0], stacked(truths, "lanes_left")[:, 0]
    offset = stacked(truths, "lane_offset_m")[:, 0]
    assert d[0] == pytest.approx(-LANE_M, abs=0.02)
    assert (away == np.where(d < -LANE_M / 2, -1, 0)).all()
    assert offset == pytest.approx(d - LANE_M * away, abs=1e-9)
    crossing = int(np.argmax(d >= -LANE_M / 2))
    assert offset[crossing - 1] > 1.5
    assert offset[crossing] < -1.5
    cause, signal = stacked(truths, "cause")[:, 0], stacked(truths, "signal")[:, 0]
    assert (cause[: crossing + 5] == SIGNALLED_CHANGE).all()
    assert ((signal == 1) == (cause == SIGNALLED_CHANGE)).all()
    assert cause[-1] == LANE_KEEPING
    assert stacked(truths, "lane_width_m") == pytest.approx(np.full((80, 3), LANE_M))
    assert stacked(truths, "on_marked_road").all()


def test_front_lateral_is_the_bumper_s_place(built) -> None:
    traffic = MadeUpTraffic(built, 6, 25.0, edge=3)
    roads = RoadNetwork.from_highway(built)
    ego = Ego(roads, traffic, 3)
    truth = drive(ego, traffic, 60)[-1]
    x = truth.x_m + CAR.bumper_m * np.cos(truth.heading_rad)
    y = truth.y_m + CAR.bumper_m * np.sin(truth.heading_rad)
    points = zip(truth.path, x, y, truth.station_m + CAR.bumper_m, strict=True)
    expected = np.array([project(roads.table, *point)[1] for point in points])
    assert ego.front_lateral_m() == pytest.approx(expected, abs=2e-3)
    assert np.abs(truth.curvature_1pm).max() > 1e-3


def test_vehicles_come_go_and_are_not_confused(built) -> None:
    """Each vehicle's truth is its own, whoever else is there; one that vanishes leaves the rest alone."""
    whole, some = MadeUpTraffic(built, 9, 28.0), MadeUpTraffic(built, 9, 28.0)
    roads = RoadNetwork.from_highway(built)
    ego, other = Ego(roads, whole, 5), Ego(roads, some, 5)
    pick = np.array([1, 4, 8])
    for step in range(150):
        a, b = whole.move(), some.move()
        if step == 60:  # vehicle 4 vanishes for good
            pick = np.array([1, 8])
        if step >= 60:
            a = select(a, np.array([0, 1, 2, 3, 5, 6, 7, 8]))
        full = ego.step(a, everyone(a))
        part = other.step(b, pick)
    assert list(part.handle) == [7, 56]
    rows = np.searchsorted(full.handle, part.handle)
    for name, mine in full._asdict().items():
        assert np.array_equal(mine[rows], getattr(part, name)), name
    nobody = ego.step(a, np.zeros(8, np.bool_))
    assert len(nobody.handle) == 0
    assert len(ego.front_lateral_m()) == 0


def test_parked_and_teleported_vehicles_begin_anew(built) -> None:
    traffic = MadeUpTraffic(built, 3, 20.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 5, Driver(**STILL))
    truth = drive(ego, traffic, 20)[-1]
    parked = traffic.move()
    parked.lane[1] = -1
    parked.lane_position_m[1] = np.nan
    truth = ego.step(parked, everyone(parked))
    assert list(truth.handle) == [0, 14]
    truth = drive(ego, traffic, 1)[-1]
    assert list(truth.handle) == [0, 7, 14]
    traffic.position[2] += 80.0  # teleported along the lane
    before, truth = truth, drive(ego, traffic, 1)[-1]
    assert truth.x_m[2] - before.x_m[2] == pytest.approx(82.0, abs=0.5)
    assert truth.speed_mps[2] == pytest.approx(20.0, abs=0.1)
    assert np.abs(truth.path_offset_m).max() < 0.05
    for name, part in truth._asdict().items():
        assert np.isfinite(part).all(), name


def test_stop_and_go(built) -> None:
    traffic = MadeUpTraffic(built, 6, 15.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 5)
    drive(ego, traffic, 20)
    truths = []
    for step in range(200):
        traffic.speed[:] = np.clip(traffic.speed + (-0.4 if step < 100 else 0.25), 0.0, 25.0)
        if step == 80:
            traffic.index[:] = (traffic.index + 1) % 3
        truths += drive(ego, traffic, 1)
    standing = stacked(truths, "speed_mps") < 1e-6
    assert standing.any()
    for name in ("yaw_rate_rps", "lateral_speed_mps"):
        assert np.isfinite(stacked(truths, name)).all()
    x, y = stacked(truths, "x_m"), stacked(truths, "y_m")
    moved = np.hypot(np.diff(x, axis=0), np.diff(y, axis=0))
    assert moved[standing[:-1] & standing[1:]].max() < 0.02
    assert moved.max() < 2.6


@pytest.mark.parametrize("share", [1.0, 0.5], ids=["Euler", "ballistic"])
def test_a_braking_vehicle_stays_where_sumo_has_it(built, share: float) -> None:
    """Whatever the integration of SUMO's step: with actionStepLength in a vType it is ballistic."""
    traffic = MadeUpTraffic(built, 3, 30.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 5, Driver(**STILL))
    drive(ego, traffic, 10)
    begin, place = drive(ego, traffic, 1)[-1].station_m, traffic.position.copy()
    for _ in range(30):
        before = traffic.speed.copy()
        traffic.speed[:] = np.maximum(before - 0.9, 0.0)
        traffic.position += 0.1 * (1.0 - share) * (before - traffic.speed)  # beyond the Euler step of `move`
        truth = drive(ego, traffic, 1)[-1]
    assert truth.station_m - begin == pytest.approx(traffic.position - place, rel=2e-3)


def test_alerted_handles_reach_their_drivers(built) -> None:
    traffic = MadeUpTraffic(built, 4, 25.0)
    sleepy = Driver(sleepy_share=1.0, microsleep_per_min=60.0, microsleep_least_s=10.0)
    ego = Ego(RoadNetwork.from_highway(built), traffic, 5, sleepy)
    for _ in range(100):
        truth = drive(ego, traffic, 1)[-1]
        if (truth.cause == MICROSLEEP).all():
            break
    assert (truth.cause == MICROSLEEP).all()
    least = ego._mind.episode_left_s.copy()
    for _ in range(15):
        snapshot = traffic.move()
        ego.step(snapshot, everyone(snapshot), alerted=np.array([7]))
        least = np.minimum(least, ego._mind.episode_left_s)
    assert least[1] == 0.0
    assert (least[[0, 2, 3]] > 0.0).all()


def test_in_a_real_run_sumo_has_the_vehicle_where_the_truth_has_it(tmp_path) -> None:
    run = prepare(load_configuration("highway"), tmp_path)
    roads = RoadNetwork.from_highway(run.network)
    with Traffic.start(run.arguments) as traffic:
        ego = Ego(roads, traffic, 1)
        place = traffic._sumo.vehicle.getLateralLanePosition
        miss, before = [], None
        for _ in range(300):
            traffic.step()
            snapshot = traffic.snapshot()
            if before is not None:  # SUMO now stands where it was put in the last step
                both, here, there = np.intersect1d(snapshot.handle, before[0], return_indices=True)
                same = snapshot.lane[here] == before[1][there]
                stands = [place(traffic.vehicle_id(handle)) for handle in both.tolist()]
                miss.append((stands - before[2][there])[same])
                assert len(both) > 0
            truth = ego.step(snapshot, everyone(snapshot))
            for name, part in truth._asdict().items():
                assert np.isfinite(part).all(), name
            if len(truth.handle):
                traffic.write_lateral(truth.handle, ego.front_lateral_m())
                before = (truth.handle, snapshot.lane.copy(), ego.front_lateral_m())
                front = truth.x_m + CAR.bumper_m * np.cos(truth.heading_rad)
                assert np.percentile(np.abs(front - snapshot.x_m), 75) < 1.0
    assert np.abs(np.concatenate(miss)).max() < 1e-6
