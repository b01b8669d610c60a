"""The smooth road: fitted against the exact highway, kernels against brute force, and a published city."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d

from sumo_net import network, road_fit
from sumo_net import road_kernels as rk
from sumo_net.highway import Element, Highway
from sumo_net.road import AHEAD_M, DASHED, MAX_BORDERS, NO_MARKING, OWN_RIGHT, SOLID, RoadNetwork

CITY = Path(__file__).parents[3] / "shared/data/bologna_pasubio/pasubio_buslanes.net.xml"
TRANSITION_M = 20.0  # a fitted curvature reaches its new value within this of where the bend changes


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return network.build(Highway(), tmp_path_factory.mktemp("highway"))


@pytest.fixture(scope="module")
def exact(built):
    return RoadNetwork.from_highway(built)


@pytest.fixture(scope="module")
def city():
    if not CITY.is_file():
        pytest.skip("the published city is not here")
    return RoadNetwork.from_net_file(CITY)


def own_stations(roads, path, step_m):
    return np.arange(roads.table.own_start_m[path], roads.table.own_end_m[path], step_m)


def poses(roads, path, s):
    return np.array([rk.pose_at(roads.table, path, at) for at in s]).T


def onto(roads, path, x, y, guess):
    points = zip(x, y, guess, strict=True)
    return np.array([rk.project(roads.table, path, *point) for point in points]).T


# --- the exact highway


def test_exact_path_is_the_alignment(built, exact):
    way = built.carriageways[1]
    path = exact.path("backward_2_1", way.edges[2:])
    offset = built.highway.lane_offset_m(1)
    s = np.linspace(way.start_m[2], way.start_m[3], 777)
    x, y, heading, curvature = way.alignment.offset_pose_at(s, offset)
    along = way.alignment.offset_length(s, offset) - way.alignment.offset_length(way.start_m[2:3], offset)
    at = exact.table.own_start_m[path] + along
    got = poses(exact, path, at)
    np.testing.assert_allclose(got[:2], [x, y], atol=1e-5)
    np.testing.assert_allclose(np.cos(got[2] - heading), 1.0, atol=1e-9)
    np.testing.assert_allclose(got[3], curvature, atol=3e-5)  # linear between samples, a metre apart
    assert exact.shape_fit_error(path) == 0.0


def test_path_reaches_behind_and_ahead(exact):
    path = exact.path("forward_2_0", ("forward_2", "forward_3"))
    table = exact.table
    assert table.own_start_m[path] >= 60.0
    assert rk.path_length(table, path) - table.own_end_m[path] >= 220.0
    assert exact.path("forward_2_0", ("forward_2", "forward_3")) == path


def test_an_old_table_stays_valid_while_paths_are_added(built):
    roads = RoadNetwork.from_highway(built)
    path = roads.path("forward_0_0")
    before, pose = roads.table, rk.pose_at(roads.table, path, 321.5)
    for edge in built.carriageways[0].edges + built.carriageways[1].edges:
        for lane in range(3):
            roads.path(f"{edge}_{lane}")
    assert len(roads.table.x_m) > len(before.x_m)
    assert rk.pose_at(roads.table, path, 321.5) == pose
    assert rk.pose_at(before, path, 321.5) == pose


def test_unknown_lane_is_a_key_error(exact):
    with pytest.raises(KeyError):
        exact.path("nowhere_0")


# --- the fit


@pytest.mark.parametrize(("decimals", "chord_error_m"), [(2, 0.005), (4, 0.005), (2, 0.05)])
def test_fit_of_a_plain_network_against_the_exact_highway(
    built, tmp_path, monkeypatch, decimals, chord_error_m
):
    """Lateral under 2 cm everywhere, curvature within 5 % outside the transitions, at every radius."""
    monkeypatch.setattr(network, "CHORD_ERROR_M", chord_error_m)
    plain = network.build(built.highway, tmp_path, decimals)
    exact, fitted = RoadNetwork.from_highway(plain), RoadNetwork.from_net_file(plain.net_file)
    radii = set()
    for way in plain.carriageways:
        for k, edge in enumerate(way.edges):
            for lane in range(built.highway.lanes):
                name, route = f"{edge}_{lane}", way.edges[k:]
                a, b = exact.path(name, route), fitted.path(name, route)
                s = own_stations(exact, a, 0.5)
                x, y, heading, curvature = poses(exact, a, s)
                guess = s - s[0] + fitted.table.own_start_m[b]
                along, d = onto(fitted, b, x, y, guess)
                assert np.abs(d).max() < 0.02, name
                assert np.abs(along - guess).max() < 0.25, name  # netconvert cuts lanes at nodes
                _, _, heading_b, curvature_b = poses(fitted, b, along)
                assert np.abs(np.sin(heading_b - heading)).max() < 0.003, name
                changes = np.abs(np.gradient(curvature, s)) > 1e-8
                steady = maximum_filter1d(changes.astype(float), 2 * round(TRANSITION_M / 0.5) + 1) == 0.0
                bend = steady & (np.abs(curvature) > 1e-6)
                radii |= {round(abs(1.0 / c), -1) for c in curvature[bend]}
                assert np.all(np.abs(curvature_b - curvature)[bend] < 0.05 * np.abs(curvature[bend])), name
                assert fitted.shape_fit_error(b) < 0.02
    assert min(radii) < 260.0
    assert max(radii) > 1900.0


def test_fit_leaves_a_straight_between_kinks_straight():
    # A long straight that turns left at both ends is no arc.
    shape = np.array([[0.0, 0.0], [50.0, 0.0], [120.0, 121.2], [70.0, 121.2]])
    smooth = road_fit.fit([shape])
    middle = np.argmin(np.hypot(smooth.x_m - 85.0, smooth.y_m - 60.6))
    assert abs(smooth.curvature_1pm[middle]) < 1e-5


def test_fit_follows_a_city_corner():
    # A quarter circle of 8 m, drawn in six chords between two straights.
    angle = np.linspace(-math.pi / 2.0, 0.0, 7)
    corner = np.column_stack([8.0 * np.cos(angle), 8.0 + 8.0 * np.sin(angle)])
    smooth = road_fit.fit([np.array([[-60.0, 0.0], [0.0, 0.0]]), corner, np.array([[8.0, 8.0], [8.0, 70.0]])])
    z = smooth.x_m + 1j * smooth.y_m
    for x, y in corner:
        assert np.min(np.abs(z - (x + 1j * y))) < 0.55  # half the spacing, and the rest
    inside = np.abs(smooth.heading_rad - math.pi / 4.0) < 0.3
    assert np.abs(np.abs(z[inside] - 8.0j) - 8.0).max() < road_fit.KINK_TOLERANCE_M
    assert smooth.curvature_1pm[inside].mean() == pytest.approx(1.0 / 8.0, rel=0.15)


def test_fit_bridges_a_gap_smoothly():
    smooth = road_fit.fit([np.array([[0.0, 0.0], [50.0, 0.0]]), np.array([[60.0, 10.0], [60.0, 60.0]])])
    assert smooth.lane_start_m[1] - smooth.lane_end_m[0] == pytest.approx(10.0 * math.pi / 2.0, rel=0.1)
    assert np.abs(smooth.curvature_1pm).max() < 0.4


def test_fit_turns_no_tighter_than_a_car_whatever_the_shape():
    smooth = road_fit.fit([np.array([[0.0, 0.0], [60.0, 0.0], [60.0, 60.0]])])
    assert np.abs(smooth.curvature_1pm).max() < 1.2
    assert 0.1 < smooth.error_m < 1.0  # and says what it costs


def test_too_short_a_road_is_refused():
    with pytest.raises(ValueError, match="too short"):
        road_fit.fit([np.array([[0.0, 0.0], [0.003, 0.0]])])
    assert road_fit.fit([np.array([[0.0, 0.0], [0.3, 0.0]])]).x_m[-1] == pytest.approx(2.0)


def test_paths_that_share_lanes_agree(built):
    roads = RoadNetwork.from_net_file(built.net_file)
    edges = built.carriageways[0].edges
    for k in range(len(edges) - 1):
        a, b = roads.path(f"{edges[k]}_1", edges[k:]), roads.path(f"{edges[k + 1]}_1", edges[k + 1 :])
        shift = roads.table.own_end_m[a] - roads.table.own_start_m[b]
        s = roads.table.own_end_m[a] + np.linspace(-60.0, 200.0, 261)
        x, y, heading, _ = poses(roads, a, s)
        along, d = onto(roads, b, x, y, s - shift)
        turned = np.abs(np.sin(poses(roads, b, along)[2] - heading))
        assert np.abs(d).max() < 0.015
        assert turned.max() < 0.002
        near = np.abs(s - roads.table.own_end_m[a]) < 20.0  # where a vehicle changes from one to the other
        assert np.abs(d[near]).max() < 0.003
        assert turned[near].max() < 0.0005


# --- kernels


def test_pose_between_samples_of_a_tight_arc(tmp_path):
    highway = Highway(elements=(Element(kind="arc", length_m=150.0, radius_m=40.0),), lanes=1)
    roads = RoadNetwork.from_highway(network.build(highway, tmp_path))
    path = roads.path("forward_0_0")
    radius = 40.0 - highway.lane_offset_m(0)
    s = np.linspace(0.0, rk.path_length(roads.table, path), 999)
    x, y, heading, curvature = poses(roads, path, s)
    np.testing.assert_allclose(np.hypot(x, y - 40.0), radius, atol=1e-6)
    np.testing.assert_allclose(heading, s / radius, atol=1e-6)
    np.testing.assert_allclose(curvature, 1.0 / radius, rtol=1e-9)


def test_path_goes_straight_on_beyond_its_ends(exact):
    path = exact.path("forward_0_1")
    x, y, heading, curvature = rk.pose_at(exact.table, path, -5.0)
    assert (x, y, heading, curvature) == pytest.approx((-5.0, -7.625, 0.0, 0.0))


def test_projection_finds_its_way_back(exact):
    path = exact.path("forward_3_1", ("forward_3", "forward_4"))
    rng = np.random.default_rng(1)
    s = rng.uniform(5.0, rk.path_length(exact.table, path) - 5.0, 300)
    d = rng.uniform(-8.0, 8.0, 300)
    x, y, heading, _ = poses(exact, path, s)
    x, y = x - d * np.sin(heading), y + d * np.cos(heading)
    for error in (0.0, 3.0, -30.0, 400.0):
        got_s, got_d = onto(exact, path, x, y, s + error)
        np.testing.assert_allclose(got_s, s, atol=1e-4)
        np.testing.assert_allclose(got_d, d, atol=1e-4)


def test_projection_of_nonsense_is_nan(exact):
    path = exact.path("forward_0_1")
    assert np.isnan(rk.project(exact.table, path, math.nan, 0.0, 0.0)).all()
    assert np.isfinite(rk.project(exact.table, path, 1e7, -1e7, 0.0)).all()


def test_station_of_a_lane_position(exact):
    path = exact.path("forward_2_0", ("forward_2", "forward_3"))
    table, length = exact.table, exact.graph.lanes["forward_2_0"].length_m
    assert rk.station_of(table, path, 0.0) == table.own_start_m[path]
    assert rk.station_of(table, path, length) == pytest.approx(table.own_end_m[path])
    assert rk.station_of(table, path, -2.0) == table.own_start_m[path] - 2.0
    assert rk.station_of(table, path, length + 3.0) == pytest.approx(table.own_end_m[path] + 3.0)
    # SUMO's place on its polyline is the place on the path.
    shape = exact.graph.lanes["forward_2_0"].shape
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(shape, axis=0).T))])
    for position in np.linspace(1.0, length - 1.0, 50):
        x, y, _, _ = rk.pose_at(table, path, rk.station_of(table, path, position))
        along = position * at[-1] / length
        gone = math.hypot(np.interp(along, at, shape[:, 0]) - x, np.interp(along, at, shape[:, 1]) - y)
        assert gone < 0.05


@pytest.mark.parametrize(
    ("d", "right", "left", "kinds", "lanes_left", "on_road"),
    [
        (0.0, -1.875, 1.875, (DASHED, DASHED), 0, True),
        (1.8, -1.875, 1.875, (DASHED, DASHED), 0, True),
        (1.9, 1.875, 5.625, (DASHED, SOLID), 1, True),
        (-5.0, -5.625, -1.875, (SOLID, DASHED), -1, True),
        (6.0, 1.875, 5.625, (DASHED, SOLID), 1, True),  # over the edge line, still beside that lane
        (7.0, 1.875, 5.625, (DASHED, SOLID), 1, False),  # on the grass
        (-8.0, -5.625, -1.875, (SOLID, DASHED), -1, True),
        (-9.0, -5.625, -1.875, (SOLID, DASHED), -1, False),
    ],
)
def test_containing_lane(exact, d, right, left, kinds, lanes_left, on_road):
    path = exact.path("forward_2_1")
    got = rk.containing_lane(exact.table, path, 300.0, d)
    assert got[:2] == pytest.approx((right, left))
    assert (got[2], got[3]) == kinds
    assert got[4:] == (lanes_left, on_road)


def test_road_ahead_is_the_path_in_the_vehicle_frame(exact):
    path = exact.path("forward_3_1", ("forward_3", "forward_4"))
    s, d, error = np.array([150.0, 320.0]), np.array([0.4, -0.7]), np.array([0.03, -0.02])
    seen = rk.ahead(exact.table, np.full(2, path), s, d, error)
    for k in range(2):
        x0, y0, h0, _ = rk.pose_at(exact.table, path, s[k])
        x, y, heading, curvature = poses(exact, path, s[k] + AHEAD_M)
        origin = x0 + 1j * y0 + 1j * d[k] * np.exp(1j * h0)
        z = (x + 1j * y - origin) * np.exp(-1j * (h0 + error[k]))
        np.testing.assert_allclose(seen.forward_m[k], z.real, atol=1e-9)
        np.testing.assert_allclose(seen.left_m[k], z.imag, atol=1e-9)
        np.testing.assert_allclose(seen.heading_rad[k], heading - h0 - error[k], atol=1e-9)
        np.testing.assert_allclose(seen.curvature_1pm[k], curvature, atol=1e-12)
    slots = seen.border_offset_m[0, 10]
    np.testing.assert_allclose(slots[OWN_RIGHT - 1 : OWN_RIGHT + 3], [-5.625, -1.875, 1.875, 5.625])
    assert np.isnan(np.delete(slots, np.arange(OWN_RIGHT - 1, OWN_RIGHT + 3))).all()
    assert seen.border_kind.dtype == np.int8
    np.testing.assert_allclose(seen.road_right_m, -5.625 - 2.5)
    np.testing.assert_allclose(seen.road_left_m, 5.625 + 0.75)
    np.testing.assert_allclose(np.diff(seen.station_m, axis=1), np.tile(np.diff(AHEAD_M), (2, 1)), rtol=0.02)


def test_lines_between_the_stations_ahead_miss_by_under_a_tenth_of_a_pixel():
    assert AHEAD_M[0] == -2.0
    assert AHEAD_M[-1] == pytest.approx(180.0)
    radius, focal = 250.0, 925.0
    at = np.linspace(6.0, 179.0, 2000)
    x, y = radius * np.sin(AHEAD_M / radius), radius * (1.0 - np.cos(AHEAD_M / radius))
    forward, left = radius * np.sin(at / radius), radius * (1.0 - np.cos(at / radius))
    miss = np.abs(np.interp(forward, x, y) - left) * focal / forward
    assert miss.max() < 0.1


def test_road_ahead_ends_with_the_path_and_where_the_road_turns_away(exact, tmp_path):
    last = exact.path("forward_5_1", ("forward_5",))
    end = rk.path_length(exact.table, last)
    seen = rk.ahead(exact.table, np.array([last]), np.array([end - 50.0]), np.zeros(1), np.zeros(1))
    np.testing.assert_array_equal(np.isnan(seen.forward_m[0]), AHEAD_M > 50.0)
    assert np.isnan(seen.border_offset_m[0, AHEAD_M > 50.0]).all()
    assert (seen.border_kind[0, AHEAD_M > 50.0] == NO_MARKING).all()

    circle = Highway(elements=(Element(kind="arc", length_m=180.0, radius_m=60.0),), lanes=1)
    roads = RoadNetwork.from_highway(network.build(circle, tmp_path))
    path = roads.path("forward_0_0")
    seen = rk.ahead(roads.table, np.array([path]), np.array([10.0]), np.zeros(1), np.zeros(1))
    turned = AHEAD_M / (60.0 - circle.lane_offset_m(0)) > math.radians(80.0)
    np.testing.assert_array_equal(np.isnan(seen.forward_m[0]), turned)


def test_road_ahead_of_a_vehicle_nowhere_is_nan(exact):
    path = np.array([exact.path("forward_0_1")])
    seen = rk.ahead(exact.table, path, np.array([math.nan]), np.zeros(1), np.zeros(1))
    assert np.isnan(seen.forward_m).all()
    assert seen.border_offset_m.shape == (1, len(AHEAD_M), MAX_BORDERS)


def test_dashes_have_one_phase_for_all_lanes(exact):
    a, b = exact.path("forward_3_0", ("forward_3", "forward_4")), exact.path("forward_3_1")
    s = np.arange(20.0, exact.table.own_end_m[a] + 200.0, 7.0)
    x, y, heading, _ = poses(exact, a, s)
    border_x, border_y = x - 1.875 * np.sin(heading), y + 1.875 * np.cos(heading)
    other, d = onto(exact, b, border_x, border_y, s)
    np.testing.assert_allclose(d, -1.875, atol=1e-6)
    phase, phase_b = (
        [rk.edge_station(exact.table, rk.segment_at(exact.table, path, at), at) for at in along]
        for path, along in ((a, s), (b, other))
    )
    np.testing.assert_allclose(phase, phase_b, atol=0.05)


# --- a published city


@pytest.mark.parametrize("degrees", [10.0, 20.0, 40.0, 90.0])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_corner_of_the_drawing_becomes_a_bend(degrees, side):
    turn = side * math.radians(degrees)
    smooth = road_fit.fit([np.array([[-60.0, 0.0], [0.0, 0.0], [60.0 * np.cos(turn), 60.0 * np.sin(turn)]])])
    depth = min(
        max(road_fit.CORNER_DEPTH_M, road_fit.CORNER_LEAST_RADIUS_M * turn**2 / 8.0), road_fit.CORNER_MOST_M
    )
    radius = min(8.0 * depth / turn**2, road_fit.CORNER_RADIUS_M)
    assert np.abs(smooth.curvature_1pm).max() < 1.0 / (
        0.55 * radius
    )  # the smoothing is no wider than its tolerance
    assert smooth.error_m < 1.3 * depth
    assert smooth.heading_rad[-1] - smooth.heading_rad[0] == pytest.approx(turn, abs=1e-3)


def test_every_lane_of_the_city_can_be_fitted(city):
    graph = city.graph
    strays = 0
    lanes = [lane for lane in graph.lanes.values() if lane.drivable]
    for lane in lanes:
        path = city.path(lane.id)
        table = city.table
        part = slice(table.first_sample[path], table.first_sample[path] + table.samples[path])
        assert np.isfinite(table.x_m[part]).all()
        error, tightest = city.shape_fit_error(path), np.abs(table.curvature_1pm[part]).max()
        # Beyond the tolerance only where a car could hardly follow the drawing.
        most = road_fit.KINK_TOLERANCE_M + road_fit.CORNER_DEPTH_M
        assert error <= most * 1.01 or tightest > 0.12, lane.id
        assert error < road_fit.CORNER_MOST_M
        strays += error > most * 1.01
    assert len(lanes) == 437
    assert strays < 0.25 * len(lanes)


def test_paths_in_the_city_hand_over_smoothly(city):
    """Where the front bumper enters the next lane, the centre of gravity keeps its offset."""
    jumps = []
    for source, connections in list(city.graph.onward.items())[::3]:
        for connection in connections:
            target = city.graph.lanes[connection.target]
            if not (city.graph.lanes[source].drivable and target.drivable):
                continue
            route = (city.graph.lanes[source].edge, target.edge)
            a = city.path(source, route)
            b = city.path(connection.via or connection.target, (target.edge,), source)
            if city.graph.onward[source][0].target != connection.target and len(connections) > 1:
                continue  # the path may take another lane of the same edge
            x, y, _, _ = rk.pose_at(city.table, a, city.table.own_end_m[a] - 1.6)
            _, d = rk.project(city.table, b, x, y, city.table.own_start_m[b] - 1.6)
            jumps.append(abs(d))
    assert len(jumps) > 100
    assert np.median(jumps) < 0.003
    assert np.percentile(jumps, 95) < 0.02
    assert max(jumps) < 0.08
