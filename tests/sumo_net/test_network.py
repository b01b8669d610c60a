"""The built-in highway: exact geometry against numerical integration, and what netconvert makes of it."""

import math

import numpy as np
import pytest
import sumo
import sumolib

from sumo_net import network
from sumo_net.highway import Element, Highway, alignment
from sumo_net.netconvert import BuildError
from sumo_net.settings import SettingsError, read


def element(kind, length, radius=None, **more):
    return Element(kind=kind, length_m=length, radius_m=radius, **more)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return network.build(Highway(), tmp_path_factory.mktemp("highway"))


def test_alignment_is_the_integral_of_its_curvature():
    line = alignment(Highway().elements)
    step = 0.05
    s = np.arange(0.0, line.length_m, step)
    x, y, heading, _ = line.pose_at(s)
    middle = line.pose_at(s + step / 2.0)[2]  # heading there, by the midpoint rule
    curvature = line.pose_at(s + step / 2.0)[3]
    np.testing.assert_allclose(np.diff(heading), curvature[:-1] * step, atol=1e-8)
    np.testing.assert_allclose(x[1:], np.cumsum(np.cos(middle[:-1])) * step, atol=1e-4)
    np.testing.assert_allclose(y[1:], np.cumsum(np.sin(middle[:-1])) * step, atol=1e-4)


def test_curvature_is_continuous_where_clothoids_stand_between():
    line = alignment(Highway().elements)
    before, after = line.pose_at(line.start_m[1:-1] - 1e-9)[3], line.pose_at(line.start_m[1:-1])[3]
    np.testing.assert_allclose(before, after, atol=1e-9)


def test_default_highway_is_what_was_ordered():
    highway = Highway()
    radii = [e.radius_m for e in highway.elements if e.radius_m]
    assert 4500.0 < alignment(highway.elements).length_m < 5500.0
    assert min(abs(r) for r in radii) == 250.0
    assert all(500.0 <= abs(r) <= 2000.0 for r in radii if abs(r) != 250.0)
    assert {math.copysign(1.0, r) for r in radii} == {-1.0, 1.0}


def test_an_arc_has_the_answers_of_a_circle():
    line = alignment((element("arc", 100.0 * math.pi, 200.0),))
    x, y, heading, curvature = line.pose_at(np.array([0.0, 100.0 * math.pi]))
    np.testing.assert_allclose([x, y, heading], [[0, 200], [0, 200], [0, math.pi / 2]], atol=1e-9)
    np.testing.assert_allclose(curvature, 1.0 / 200.0)
    np.testing.assert_allclose(line.offset_pose_at(np.array([0.0]), 50.0)[3], 1.0 / 150.0)


def test_reversed_alignment_is_the_same_line_the_other_way():
    line = alignment(Highway().elements)
    s = np.linspace(0.0, line.length_m, 300)
    x, y, heading, curvature = line.pose_at(s)
    back = line.reversed().pose_at(line.length_m - s)
    np.testing.assert_allclose(back[:2], [x, y], atol=1e-9)
    np.testing.assert_allclose(np.cos(back[2] - heading), -1.0)
    np.testing.assert_allclose(back[3], -curvature, atol=1e-12)


def test_offset_length_inverts():
    line = alignment(Highway().elements)
    s = np.linspace(0.0, line.length_m, 100)
    np.testing.assert_allclose(line.station_of_offset_length(line.offset_length(s, -9.0), -9.0), s, atol=1e-8)


@pytest.mark.parametrize(
    ("kind", "radius", "says"),
    [("arc", None, "needs one"), ("straight", 500.0, "has none"), ("arc", 10.0, "at least 30 m")],
)
def test_bad_elements_are_refused(kind, radius, says):
    with pytest.raises(SettingsError, match=says):
        read(Element, {"kind": kind, "length_m": 10.0, "radius_m": radius}, "test")


@pytest.mark.parametrize(
    ("mapping", "says"),
    [
        (
            {"elements": [{"kind": "straight", "lenght_m": 9}]},
            "'elements.0.lenght_m': did you mean 'length_m'",
        ),
        ({"elements": [{"kind": "spiral", "length_m": 9}]}, "elements.0.kind = 'spiral'"),
        ({"lanes": 9}, "lanes = 9"),
        ({"elements": []}, "elements = "),
    ],
)
def test_bad_highway_settings_are_named(mapping, says):
    with pytest.raises(SettingsError) as refused:
        read(Highway, mapping, "mine.toml")
    assert f"mine.toml: unknown key {says}" in str(refused.value) or f"mine.toml: {says}" in str(
        refused.value
    )


def test_too_wide_a_highway_is_refused():
    with pytest.raises(ValueError, match="too tight"):
        Highway(elements=(element("arc", 50.0, 30.0),), median_m=40.0)


def test_network_has_both_directions_with_their_lanes_and_limits(built):
    net = sumolib.net.readNet(str(built.net_file))
    for way in built.carriageways:
        for name, limit, length in zip(way.edges, way.speed_limit_mps, np.diff(way.start_m), strict=True):
            edge = net.getEdge(name)
            assert [lane.getWidth() for lane in edge.getLanes()] == [3.75] * 3
            assert edge.getSpeed() == pytest.approx(limit, abs=1e-3)
            assert edge.getLength() == pytest.approx(length, rel=0.03)
        for a, b in zip(way.edges[:-1], way.edges[1:], strict=True):
            joined = net.getEdge(a).getOutgoing()
            assert [e.getID() for e in joined] == [b]
            pairs = {
                (c.getFromLane().getIndex(), c.getToLane().getIndex())
                for connections in joined.values()
                for c in connections
            }
            assert pairs == {(0, 0), (1, 1), (2, 2)}
    assert len(built.carriageways[0].edges) >= 5


def test_lane_polylines_lie_on_the_exact_lanes(built):
    net = sumolib.net.readNet(str(built.net_file))
    for way in built.carriageways:
        for k, name in enumerate(way.edges):
            for lane in net.getEdge(name).getLanes():
                offset = built.highway.lane_offset_m(lane.getIndex())
                s = np.arange(way.start_m[k], way.start_m[k + 1], 0.25)
                x, y, _, _ = way.alignment.offset_pose_at(s, offset)
                z = x + 1j * y
                for px, py in lane.getShape()[1:-1:7]:
                    assert np.min(np.abs(z - (px + 1j * py))) < 0.15  # half of the sampling, and the rest
                assert len(lane.getShape()) < 400


def test_constant_radius_and_straight_only(tmp_path):
    for name, piece in (("bend", element("arc", 300.0, -250.0)), ("straight", element("straight", 300.0))):
        built = network.build(Highway(elements=(piece,), lanes=2), tmp_path / name)
        net = sumolib.net.readNet(str(built.net_file))
        assert net.getEdge("forward_0").getLaneNumber() == 2
        assert net.getEdge("backward_0").getLength() == pytest.approx(300.0, rel=0.05)


def test_long_pieces_become_several_edges():
    way = network.carriageway(Highway(elements=(element("straight", 4000.0),)), "forward")
    assert len(way.edges) == 3
    np.testing.assert_allclose(way.start_m, [0.0, 4000 / 3, 8000 / 3, 4000.0])


def test_netconvert_failure_is_told_in_its_words(tmp_path, monkeypatch):
    monkeypatch.setitem(network._WRITERS, "con", lambda highway, way: ['<connection from="nowhere" to="x"/>'])
    with pytest.raises(BuildError, match=r"netconvert failed.*nowhere"):
        network.build(Highway(elements=(element("straight", 300.0),)), tmp_path)


def test_missing_netconvert_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(sumo, "SUMO_HOME", str(tmp_path))
    with pytest.raises(BuildError, match="pip install eclipse-sumo"):
        network.build(Highway(elements=(element("straight", 300.0),)), tmp_path / "out")
