"""Roads of OpenStreetMap and OpenDRIVE: the bends that were drawn, and files that are something else."""

import gzip
import math
from pathlib import Path

import numpy as np
import pytest

from plugin.configuration import load_configuration
from sumo_net import lane_graph, scenario
from sumo_net.road import RoadNetwork
from sumo_net.settings import SettingsError
from sumo_net.traffic import Traffic

RADIUS_M, SPIRAL_M, ARC_M, STRAIGHT_M = 300.0, 60.0, 250.0, 200.0
LANE_M = 3.5


def opendrive() -> str:
    """Straight, clothoid, arc to the left; one lane each way; uphill, which the network leaves out."""
    bend = 1.0 / RADIUS_M
    ahead = np.linspace(0.0, SPIRAL_M, 100_001)
    heading = 0.5 * bend * ahead**2 / SPIRAL_M
    x = STRAIGHT_M + np.trapezoid(np.cos(heading), ahead)
    y = np.trapezoid(np.sin(heading), ahead)
    lane = '<lane id="{}" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane>'
    return f"""<?xml version="1.0"?>
<OpenDRIVE>
  <header revMajor="1" revMinor="6"/>
  <road name="bend" length="{STRAIGHT_M + SPIRAL_M + ARC_M}" id="7" junction="-1">
    <planView>
      <geometry s="0" x="0" y="0" hdg="0" length="{STRAIGHT_M}"><line/></geometry>
      <geometry s="{STRAIGHT_M}" x="{STRAIGHT_M}" y="0" hdg="0" length="{SPIRAL_M}">
        <spiral curvStart="0" curvEnd="{bend}"/>
      </geometry>
      <geometry s="{STRAIGHT_M + SPIRAL_M}" x="{x}" y="{y}" hdg="{heading[-1]}" length="{ARC_M}">
        <arc curvature="{bend}"/>
      </geometry>
    </planView>
    <elevationProfile><elevation s="0" a="5" b="0.03" c="0" d="0"/></elevationProfile>
    <lanes><laneSection s="0">
      <left>{lane.format(1)}</left><center><lane id="0" type="none"/></center><right>{lane.format(-1)}</right>
    </laneSection></lanes>
  </road>
</OpenDRIVE>
"""


def openstreetmap() -> str:
    """A road of two lanes and a footpath, to the east at 48° north."""
    nodes = [f'<node id="{i}" lat="48.0" lon="{11.0 + 0.004 * i}"/>' for i in range(1, 5)]
    ways = [
        '<way id="10"><nd ref="1"/><nd ref="2"/><nd ref="3"/>'
        '<tag k="highway" v="primary"/><tag k="lanes" v="2"/><tag k="maxspeed" v="90"/></way>',
        '<way id="11"><nd ref="3"/><nd ref="4"/><tag k="highway" v="footway"/></way>',
    ]
    return "\n".join(['<osm version="0.6">', *nodes, *ways, "</osm>"])


def network(file: Path, lefthand: bool = False) -> lane_graph.LaneGraph:
    configuration = load_configuration(str(file), {"lefthand": lefthand})
    made = scenario.road(configuration, file.parent)
    assert isinstance(made, Path)
    return lane_graph.read(made)


def test_an_opendrive_road_bends_as_it_was_drawn(tmp_path: Path) -> None:
    file = tmp_path / "bend.xodr"
    file.write_text(opendrive())
    roads = RoadNetwork(network(file))
    number = roads.path("-7_0")
    table = roads.table
    first, count = int(table.first_sample[number]), int(table.samples[number])
    station = np.arange(count) * table.spacing_m[number]
    bend = table.curvature_1pm[first : first + count]
    right = RADIUS_M + LANE_M / 2.0  # of the right lane's middle
    arc = (station > STRAIGHT_M + SPIRAL_M + 20.0) & (station < STRAIGHT_M + SPIRAL_M + ARC_M - 20.0)
    np.testing.assert_allclose(bend[arc], 1.0 / right, rtol=0.02)
    np.testing.assert_allclose(bend[station < STRAIGHT_M - 20.0], 0.0, atol=2e-5)
    assert roads.shape_fit_error(number) < 0.02
    np.testing.assert_allclose(table.y_m[first], -LANE_M / 2.0, atol=0.01)


def test_lanes_beside_a_median_and_a_hard_shoulder_stay_where_they_are(tmp_path: Path) -> None:
    lanes = (("border", 2.6), ("driving", 3.9), ("driving", 3.9), ("stop", 3.6), ("sidewalk", 2.0))
    right = "".join(
        f'<lane id="-{i}" type="{name}"><width sOffset="0" a="{width}" b="0" c="0" d="0"/>'
        '<speed sOffset="0" max="130" unit="km/h"/></lane>'
        for i, (name, width) in enumerate(lanes, start=1)
    )
    file = tmp_path / "motorway.xodr"
    file.write_text(f"""<OpenDRIVE><header revMajor="1" revMinor="4"/>
      <road name="" length="500" id="1" junction="-1">
        <planView><geometry s="0" x="0" y="0" hdg="0" length="500"><line/></geometry></planView>
        <lanes><laneSection s="0">
          <center><lane id="0" type="none"/></center><right>{right}</right>
        </laneSection></lanes>
      </road></OpenDRIVE>""")
    found = [lane for lane in network(file).lanes.values() if lane.drivable]
    middles = [-(2.6 + 3.9 + 1.95), -(2.6 + 1.95)]  # from the right
    np.testing.assert_allclose([lane.shape[0, 1] for lane in found], middles, atol=0.01)
    np.testing.assert_allclose([lane.speed_limit_mps for lane in found], 130.0 / 3.6, atol=0.01)


@pytest.mark.parametrize("lefthand", [False, True])
def test_an_openstreetmap_extract(tmp_path: Path, lefthand: bool) -> None:
    file = tmp_path / "town.osm.gz"
    file.write_bytes(gzip.compress(openstreetmap().encode()))
    graph = network(file, lefthand)
    length = 0.008 * math.cos(math.radians(48.0)) * 111_320.0
    lanes = [
        lane for lane in graph.lanes.values() if lane.drivable and len(lane.shape) and lane.length_m > 50
    ]
    assert {lane.speed_limit_mps for lane in lanes} == {25.0}
    east = [lane for lane in lanes if lane.shape[-1, 0] > lane.shape[0, 0]]
    west = [lane for lane in lanes if lane.shape[-1, 0] < lane.shape[0, 0]]
    assert sum(lane.length_m for lane in east) == pytest.approx(length, rel=0.01)
    north_of_other = east[0].shape[0, 1] > west[0].shape[-1, 1]
    assert north_of_other == lefthand  # a footpath would be the fifth lane
    assert len(lanes) == 2


def test_a_run_on_an_extract(tmp_path: Path) -> None:
    file = tmp_path / "town.osm"
    file.write_text(openstreetmap())
    prepared = scenario.prepare(load_configuration(str(file)), tmp_path / "work")
    with Traffic.start(prepared.arguments) as traffic:
        for _ in range(300):
            traffic.step()
        assert len(traffic.snapshot().handle) > 0


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.osm", "<html></html>", "a.osm: begins with <html>, an OpenStreetMap extract begins with <osm>"),
        ("a.xodr", "no XML", "a.xodr: is not XML, an OpenDRIVE file begins with <OpenDRIVE>"),
        ("a.osm", '<!DOCTYPE osm [<!ENTITY e "x">]><osm/>', "declares the XML entity 'e'"),
        ("a.osm", '<osm version="0.6"></osm>', "a.osm: "),
        ("a.osm.gz", "<osm/>", "a.osm.gz: "),
    ],
)
def test_what_is_no_road(tmp_path: Path, name: str, text: str, words: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(SettingsError) as caught:
        scenario.prepare(load_configuration(str(tmp_path / name)), tmp_path / "work")
    assert words in str(caught.value)


def test_what_netconvert_says_of_a_file_cannot_steer_a_terminal(tmp_path: Path) -> None:
    file = tmp_path / "a.osm"
    file.write_text(openstreetmap().replace('lat="48.0"', 'lat="4\x7f\u202e8"'))
    with pytest.raises(SettingsError, match="netconvert failed") as caught:
        scenario.prepare(load_configuration(str(file)), tmp_path / "work")
    assert str(caught.value).isprintable()


def test_who_keeps_left_is_asked_of_converted_roads_alone() -> None:
    with pytest.raises(SettingsError, match="lefthand = true: only with a net_file that is converted"):
        load_configuration("highway", {"lefthand": True})


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(SettingsError, match=r"none\.osm: no such file"):
        load_configuration(str(tmp_path / "none.osm"))
