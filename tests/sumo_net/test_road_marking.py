"""Markings on small networks made by netconvert."""

import subprocess
from pathlib import Path

import numpy as np
import pytest
import sumo

from sumo_net import lane_graph
from sumo_net.road_marking import Markings
from sumo_net.road_table import DASHED, NO_MARKING, OWN_RIGHT, SOLID

NODES = """<nodes><node id="w" x="0" y="0"/><node id="m" x="200" y="0"/><node id="e" x="400" y="0"/>
<node id="n" x="200" y="200"/></nodes>"""


def markings(tmp_path, edges, connections=""):
    files = {
        "nod": NODES,
        "edg": f"<edges>{edges}</edges>",
        "con": f"<connections>{connections}</connections>",
    }
    for suffix, text in files.items():
        (tmp_path / f"x.{suffix}.xml").write_text(text, encoding="utf-8")
    net = tmp_path / "x.net.xml"
    command = [str(Path(sumo.SUMO_HOME) / "bin" / "netconvert"), "-o", str(net), "--xml-validation", "never"]
    command += ["-n", str(tmp_path / "x.nod.xml"), "-e", str(tmp_path / "x.edg.xml")]
    command += ["-x", str(tmp_path / "x.con.xml"), "--no-turnarounds", "true"]
    subprocess.run(command, check=True, capture_output=True)
    return Markings(lane_graph.read(net), 0.5, 0.5)


def painted(section):
    used = ~np.isnan(section.border_offset_m)
    first = int(np.argmax(used))
    return (
        [round(float(d), 3) for d in section.border_offset_m[used]],
        section.border_kind[used].tolist(),
        OWN_RIGHT - first,
    )


def test_one_way_road_with_lanes_of_different_width(tmp_path):
    lanes = '<lane index="0" width="3.0"/><lane index="1" width="3.5"/><lane index="2" width="4.0"/>'
    made = markings(tmp_path, f'<edge id="a" from="w" to="m" numLanes="3">{lanes}</edge>')
    assert painted(made.section("a_0")) == ([-1.5, 1.5, 5.0, 9.0], [SOLID, DASHED, DASHED, SOLID], 0)
    assert painted(made.section("a_1")) == ([-4.75, -1.75, 1.75, 5.75], [SOLID, DASHED, DASHED, SOLID], 1)
    assert painted(made.section("a_2")) == ([-8.5, -5.5, -2.0, 2.0], [SOLID, DASHED, DASHED, SOLID], 2)
    assert made.section("a_1").road_right_m == pytest.approx(-5.25)
    assert made.section("a_1").road_left_m == pytest.approx(6.25)


def test_foot_bicycle_and_bus_lanes_lie_behind_a_solid_line(tmp_path):
    lanes = '<lane index="0" allow="pedestrian" width="2"/><lane index="1" allow="bicycle" width="1.5"/>'
    lanes += '<lane index="4" allow="bus"/>'
    made = markings(tmp_path, f'<edge id="a" from="w" to="m" numLanes="5">{lanes}</edge>')
    assert painted(made.section("a_2")) == ([-1.6, 1.6, 4.8], [SOLID, DASHED, SOLID], 0)
    assert made.section("a_2").road_right_m == pytest.approx(-1.6 - 1.5 - 0.5)  # the pavement is no asphalt
    assert made.section("a_2").road_left_m == pytest.approx(4.8 + 3.2 + 0.5)


def test_undivided_road_has_a_middle_line(tmp_path):
    edges = '<edge id="a" from="w" to="m" numLanes="1"/><edge id="b" from="m" to="w" numLanes="1"/>'
    made = markings(tmp_path, edges)
    assert painted(made.section("a_0")) == ([-1.6, 1.6, 4.8], [SOLID, DASHED, SOLID], 0)
    assert made.section("a_0").road_left_m == pytest.approx(5.3)


def test_undivided_road_of_four_lanes_has_a_solid_middle_line(tmp_path):
    edges = '<edge id="a" from="w" to="m" numLanes="2"/><edge id="b" from="m" to="w" numLanes="2"/>'
    made = markings(tmp_path, edges)
    kinds = [SOLID, DASHED, SOLID, DASHED, SOLID]
    assert painted(made.section("a_1")) == ([-4.8, -1.6, 1.6, 4.8, 8.0], kinds, 1)


def test_divided_road_knows_nothing_of_the_other_side(tmp_path):
    edges = '<edge id="a" from="w" to="m" numLanes="1"/>'
    edges += '<edge id="b" from="m" to="w" numLanes="1" shape="200,9 0,9"/>'
    assert painted(markings(tmp_path, edges).section("a_0")) == ([-1.6, 1.6], [SOLID, SOLID], 0)


def test_more_lanes_than_slots_end_dashed(tmp_path):
    made = markings(tmp_path, '<edge id="a" from="w" to="m" numLanes="7"/>')
    assert painted(made.section("a_0"))[1] == [SOLID, DASHED, DASHED, DASHED, DASHED]
    assert painted(made.section("a_6"))[1] == [DASHED, DASHED, DASHED, DASHED, SOLID]


def test_marking_goes_on_through_a_node_that_only_joins(tmp_path):
    edges = (
        '<edge id="a" from="w" to="m" numLanes="2"/><edge id="b" from="m" to="e" numLanes="2" speed="20"/>'
    )
    made = markings(tmp_path, edges)
    assert made.joins("a") == "b"
    via = next(lane.id for lane in made.graph.lanes.values() if lane.internal)
    assert painted(made.section(via))[1] == [SOLID, DASHED, SOLID]
    end, start = made.section("a_0").edge_station_m[-1], made.section("b_0").edge_station_m[0]
    assert start == pytest.approx(end, abs=0.02)
    assert start == pytest.approx(200.0, abs=0.2)


def test_nothing_is_painted_in_a_junction(tmp_path):
    edges = '<edge id="a" from="w" to="m" numLanes="2"/><edge id="b" from="m" to="e" numLanes="2"/>'
    edges += '<edge id="c" from="n" to="m" numLanes="1"/>'
    made = markings(tmp_path, edges)
    assert made.joins("a") == ""
    internal = [lane for lane in made.graph.lanes.values() if lane.internal and lane.drivable]
    assert internal
    for lane in internal:
        section = made.section(lane.id)
        assert (section.border_kind == NO_MARKING).all()
        assert section.border_offset_m[OWN_RIGHT] == pytest.approx(-lane.width_m / 2.0)
        assert section.road_left_m > lane.width_m / 2.0


def test_a_lane_that_ends_is_no_joining_node(tmp_path):
    edges = '<edge id="a" from="w" to="m" numLanes="3"/><edge id="b" from="m" to="e" numLanes="2"/>'
    assert markings(tmp_path, edges).joins("a") == ""


def test_a_ring_has_a_beginning(tmp_path):
    edges = '<edge id="a" from="w" to="m"/><edge id="b" from="m" to="n"/><edge id="c" from="n" to="w"/>'
    made = markings(tmp_path, edges)
    lanes = [made.section(f"{edge}_0").edge_station_m for edge in "abc"]
    assert all(np.isfinite(lane).all() and (np.diff(lane) > 0).all() for lane in lanes)
