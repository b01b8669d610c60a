"""Reading networks: refused files and their messages; gzip; permissions; successors."""

import gzip

import pytest

from sumo_net import lane_chain, lane_graph
from sumo_net.road import NetworkError, RoadNetwork

EDGE = """<edge id="{id}" from="{id}a" to="{id}b">
    <lane id="{id}_0" index="0" {access} speed="13.9" length="100" shape="{x},0.00 {end},0.00"/></edge>"""


def net(*edges, connections="", head=""):
    return f'<?xml version="1.0"?>{head}<net version="1.20">{"".join(edges)}{connections}</net>'


def edge(name, x=0, access=""):
    return EDGE.format(id=name, x=x, end=x + 100, access=access)


def written(tmp_path, text):
    file = tmp_path / "mine.net.xml"
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (net(edge("a")).replace("</net>", ""), "not well-formed XML"),
        ("", "not well-formed XML"),
        ("no network at all", "not well-formed XML"),
        ("<routes/>", "its root is <routes>, not <net>"),
        (net(), "no lane that passenger cars may use"),
        (net(edge("a", access='allow="bus tram"')), "no lane that passenger cars may use"),
        (net(edge("a")).replace('length="100"', 'length="-3"'), "lane 'a_0': length = -3.0"),
        (net(edge("a")).replace('length="100"', 'length="nan"'), "lane 'a_0': length = nan"),
        (net(edge("a")).replace('length="100"', ""), "'length' is missing"),
        (net(edge("a")).replace("0,0.00 100,0.00", "0,0.00"), "fewer than two points"),
        (net(edge("a")).replace("100,0.00", "100,inf"), "not finite"),
        (net(edge("a")).replace("100,0.00", "100,x"), "line 2"),
        (
            net(edge("a"), connections='<connection from="a" to="b" fromLane="0" toLane="0"/>'),
            "unknown lanes",
        ),
    ],
)
def test_a_bad_network_is_told_with_its_name(tmp_path, text, says):
    file = written(tmp_path, text)
    with pytest.raises(NetworkError, match=str(file.name)) as refused:
        RoadNetwork.from_net_file(file)
    assert says in str(refused.value)
    assert "\n" not in str(refused.value)


def test_xml_entities_are_refused_not_expanded(tmp_path):
    bomb = '<!DOCTYPE net [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
    file = written(tmp_path, net(edge("a"), head=bomb).replace('id="a"', 'id="&b;"'))
    with pytest.raises(NetworkError, match="declares the XML entity 'a'"):
        lane_graph.read(file)


def test_missing_file_and_folder_and_broken_gzip(tmp_path):
    with pytest.raises(NetworkError, match="no such file"):
        lane_graph.read(tmp_path / "none.net.xml")
    with pytest.raises(NetworkError, match="cannot be read"):
        lane_graph.read(tmp_path)
    cut = tmp_path / "cut.net.xml.gz"
    cut.write_bytes(gzip.compress(net(edge("a")).encode())[:-20])
    with pytest.raises(NetworkError, match="cannot be read"):
        lane_graph.read(cut)
    cut.write_bytes(b"\x1f\x8b" + bytes(range(200)))
    with pytest.raises(NetworkError, match="cannot be read"):
        lane_graph.read(cut)


def test_gzip_is_read_as_plain(tmp_path):
    file = tmp_path / "mine.net.xml.gz"
    file.write_bytes(gzip.compress(net(edge("a")).encode()))
    assert lane_graph.read(file).drivable_edges() == ["a"]


@pytest.mark.parametrize(
    ("access", "drivable"),
    [
        ("", True),
        ('allow="all"', True),
        ('allow="bus passenger"', True),
        ('allow="pedestrian"', False),
        ('disallow="all"', False),
        ('disallow="passenger"', False),
        ('disallow="tram rail"', True),
        ('width="0"', False),
    ],
)
def test_who_may_drive(tmp_path, access, drivable):
    graph = lane_graph.read(written(tmp_path, net(edge("a", access=access), edge("other", 200))))
    assert graph.lanes["a_0"].drivable is drivable
    assert graph.drivable_edges() == (["a", "other"] if drivable else ["other"])


def test_three_dimensional_shapes_and_widths(tmp_path):
    text = net(edge("a", access='width="4.5"')).replace("0,0.00 100,0.00", "0,0.00,7.5 100,0.00,8")
    lane = lane_graph.read(written(tmp_path, text)).lanes["a_0"]
    assert lane.shape.tolist() == [[0.0, 0.0], [100.0, 0.0]]
    assert lane.width_m == 4.5


def connection(a, b, direction="s"):
    return f'<connection from="{a}" to="{b}" fromLane="0" toLane="0" dir="{direction}"/>'


def test_chain_follows_the_route_and_then_goes_straight_on(tmp_path):
    edges = [edge(name, k * 100) for k, name in enumerate("abcdef")]
    ways = connection("a", "b") + connection("a", "c", "l") + connection("c", "d", "r") + connection("c", "e")
    ways += connection("e", "f") + connection("f", "a", "l")
    graph = lane_graph.read(written(tmp_path, net(*edges, connections=ways)))
    assert lane_chain.lanes_ahead(graph, "a_0", ("a", "c", "d")) == ["c_0", "d_0"]
    assert lane_chain.lanes_ahead(graph, "a_0", ("a", "c")) == ["c_0", "e_0", "f_0"]
    assert lane_chain.lanes_ahead(graph, "a_0", ()) == ["b_0"]
    assert lane_chain.lanes_ahead(graph, "a_0", ("a", "f")) == ["b_0"]  # no such way: straight on
    assert lane_chain.lanes_behind(graph, "a_0", "f_0") == ["f_0"]
    assert lane_chain.lanes_behind(graph, "f_0") == ["e_0"]
    assert lane_chain.lanes_behind(graph, "c_0") == []  # who begins here has turned round no corner
    pieces, own = lane_chain.chain(graph, "a_0", ("a", "c"), "f_0")
    assert [p.lane for p in pieces] == ["f_0", "a_0", "c_0", "e_0", "f_0"]
    assert own == 1
    assert pieces[-1].end == pytest.approx(0.6)  # 260 m beyond the lane


def test_the_lane_it_came_from_decides_what_lies_behind(tmp_path):
    edges = [edge(name, k * 100) for k, name in enumerate("abc")]
    ways = connection("a", "c") + connection("b", "c", "r")
    graph = lane_graph.read(written(tmp_path, net(*edges, connections=ways)))
    assert lane_chain.lanes_behind(graph, "c_0") == ["a_0"]
    assert lane_chain.lanes_behind(graph, "c_0", came_from="b_0") == ["b_0"]


def test_who_begins_on_a_lane_shorter_than_a_vehicle_stands_on_those_behind_it(tmp_path):
    edges = [edge("a", 0), edge("b", 100), edge("c", 200).replace('length="100"', 'length="2"')]
    ways = connection("a", "b", "l") + connection("b", "c", "r")
    graph = lane_graph.read(written(tmp_path, net(*edges, connections=ways)))
    assert lane_chain.lanes_behind(graph, "c_0") == ["b_0"]
    assert lane_chain.lanes_behind(graph, "b_0") == []
