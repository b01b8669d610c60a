"""True conflicts against SUMO's own SSM device in a real run, and their matching with warnings by hand."""

import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import sumo

from plugin.conflicts import ConflictBook
from plugin.events import NOWHERE, Place, event_columns
from plugin.leaders import LaneOrder, Leaders, in_view, nobody, overlapped, path_leaders, warned_of
from plugin.record import Recorder
from plugin.schema import TABLES
from tests.processes import in_process
from tests.roads import objects_at

BIN = Path(sumo.SUMO_HOME) / "bin"
NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="900" y="0"/><node id="c" x="1800" y="200"/></nodes>'
EDGES = """<edges><edge id="ab" from="a" to="b" numLanes="2" speed="33"/>
<edge id="bc" from="b" to="c" numLanes="2" speed="22"/></edges>"""
ROUTES = """<routes>
  <vType id="hurried" length="4.5" tau="0.4" minGap="1" sigma="0.9" actionStepLength="1" speedDev="0.2"/>
  <vType id="lorry" vClass="truck" length="14" maxSpeed="22" sigma="0.5"/>
  <route id="through" edges="ab bc"/>
  <flow id="car" type="hurried" route="through" begin="0" end="{end}" period="2.2" departLane="random"
   departSpeed="max"><param key="has.ssm.device" value="true"/></flow>
  <flow id="lorry" type="lorry" route="through" begin="5" end="{end}" period="25" departSpeed="20"/>
</routes>"""


def run_beside_ssm(folder: Path, seconds: int) -> list[tuple[float, str, str, float, float]]:
    """(time, vehicle, leader, gap, time to collision) as found here; SUMO writes its own."""
    from sumo_net import lane_graph
    from sumo_net.traffic import Traffic

    words = f"-n {folder}/n.net.xml --route-files {folder}/n.rou.xml --step-length 0.1 --no-step-log true"
    words += f" --no-warnings true --precision 7 --end {seconds} --collision.action none --seed 7"
    words += " --device.ssm.measures TTC --device.ssm.thresholds 3.5 --device.ssm.range 200"
    words += f" --device.ssm.trajectories true --device.ssm.extratime 0 --device.ssm.file {folder}/ssm.xml"
    found = []
    with Traffic.start(words.split()) as traffic:
        order = LaneOrder(lane_graph.read(traffic.net_file), traffic.lane_ids, traffic.route_ahead)
        for _ in range(10 * seconds - 1):
            traffic.step()
            snapshot = traffic.snapshot()
            leaders = order.leaders(snapshot, snapshot.handle)
            for i in np.flatnonzero(leaders.ttc_s < 3.4):
                names = traffic.vehicle_id(snapshot.handle[i]), traffic.vehicle_id(leaders.handle[i])
                found.append(
                    (round(traffic.time_s, 1), *names, float(leaders.gap_m[i]), float(leaders.ttc_s[i]))
                )
    return found


def ssm_ttc(file: Path) -> dict[tuple[float, str, str], float]:
    """SUMO's values for followers; its stamp is one step before the time at which we read the same state."""
    out = {}
    for conflict in ET.parse(file).getroot().iter("conflict"):
        times, types, values = (
            (conflict.find(name).attrib["values"]).split() for name in ("timeSpan", "typeSpan", "TTCSpan")
        )
        for time, kind, value in zip(times, types, values, strict=True):
            if kind == "2" and value != "NA":
                key = round(float(time) + 0.1, 1), conflict.attrib["ego"], conflict.attrib["foe"]
                out[key] = float(value)
    return out


def test_time_to_collision_is_that_of_sumos_own_device(tmp_path: Path) -> None:
    seconds = 120
    (tmp_path / "n.nod.xml").write_text(NODES)
    (tmp_path / "n.edg.xml").write_text(EDGES)
    (tmp_path / "n.rou.xml").write_text(ROUTES.format(end=seconds))
    command = [str(BIN / "netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml", "-o", "n.net.xml"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    ours = in_process(run_beside_ssm, tmp_path, seconds)
    theirs = ssm_ttc(tmp_path / "ssm.xml")
    cars = {(t, ego, foe): ttc for t, ego, foe, _, ttc in ours if ego.startswith("car")}
    common = [key for key in cars if key in theirs]
    assert len([key for key in common if theirs[key] < 3.0]) > 100
    assert len({key[1:] for key in common}) > 10
    errors = np.array([cars[key] - theirs[key] for key in common])
    assert np.abs(errors).max() < 0.05
    assert np.quantile(np.abs(errors), 0.99) < 1e-5
    missed = [
        key for key, ttc in theirs.items() if ttc < 3.0 and key not in cars and 1.0 < key[0] < seconds - 1
    ]
    assert len(missed) < 0.02 * len(common)


def leaders(handle: int, gap: float, closing: float) -> Leaders:
    ttc = gap / closing if closing > 0 else np.inf
    return Leaders(np.array([handle]), np.array([gap]), np.array([closing]), np.array([ttc]))


def play(
    gaps: np.ndarray,
    closing: float | np.ndarray,
    levels: np.ndarray,
    leader: int = 9,
    visible: bool = True,
    final: bool = True,
) -> tuple[list, list]:
    """One vehicle, 0.1 s a step."""
    book = ConflictBook()
    conflicts, warnings = [], []
    rates = np.broadcast_to(closing, gaps.shape)
    for k, (gap, rate, level) in enumerate(zip(gaps, rates, levels, strict=True)):
        truth = leaders(leader, gap, rate) if leader >= 0 else nobody(1)
        t = round(0.1 * k, 1)
        book.add(
            t,
            np.array([4]),
            truth,
            nobody(1),
            nobody(1),
            np.array([visible]),
            np.array([25.0]),
            np.array([level]),
            truth.ttc_s,
            lambda i, x_m=2.5 * k: Place("in_2", x_m, 7.0),
        )
        if k % 17 == 16:
            a, b = book.settle(t)
            conflicts, warnings = conflicts + a, warnings + b
    a, b = book.settle(np.inf, final)
    return conflicts + a, warnings + b


def closing_in() -> np.ndarray:
    """5 m/s closer from 40 m: TTC 3 s after 5 s, 2 s after 6 s, least after 7 s (1 s), then far away."""
    t = np.arange(150) / 10
    return np.where(t <= 7.0, 40.0 - 5.0 * t, 100.0)


def test_conflict_by_hand() -> None:
    levels = np.zeros(150, int)
    levels[45:80], levels[62:70] = 1, 2
    conflicts, warnings = play(closing_in(), 5.0, levels)
    (row,) = conflicts
    assert (row["handle"], row["target"]) == (4, 9)
    assert row["start_s"] == pytest.approx(5.1)  # the first step under 3 s
    assert (row["lane_id"], row["true_x_m"], row["true_y_m"]) == ("in_2", 127.5, 7.0)
    assert row["critical_s"] == pytest.approx(6.1)
    assert (row["end_s"], row["min_gap_m"], row["min_ttc_s"]) == pytest.approx((7.0, 5.0, 1.0))
    assert row["visible_s"] == pytest.approx(6.1)
    assert row["warned"]
    assert row["lead_time_s"] == pytest.approx(6.1 - 4.5)
    reminder, danger = sorted(warnings, key=lambda w: w["start_s"])
    assert [one["true_x_m"] for one in (reminder, danger)] == [112.5, 155.0]  # where each began
    assert (reminder["level"], reminder["start_s"], reminder["end_s"]) == (
        "reminder",
        4.5,
        pytest.approx(7.9),
    )
    assert (danger["level"], danger["start_s"], danger["end_s"]) == ("danger", 6.2, pytest.approx(6.9))
    assert reminder["outcome"] == danger["outcome"] == "true"
    assert reminder["ttc_s"] == pytest.approx(17.5 / 5.0)


def test_warning_too_late_is_no_warning() -> None:
    levels = np.zeros(150, int)
    levels[64:80] = 1
    (row,), (warning,) = play(closing_in(), 5.0, levels)
    assert not row["warned"]
    assert row["lead_time_s"] == pytest.approx(-0.3)
    assert warning["outcome"] == "true"
    (unwarned,), _ = play(closing_in(), 5.0, np.zeros(150, int))
    assert (unwarned["warned"], unwarned["lead_time_s"]) == (False, None)


@pytest.mark.parametrize(
    ("gap", "closing", "leader", "outcome"),
    [
        (60.0, 3.0, 9, "nuisance"),
        (12.0, -1.0, 9, "nuisance"),
        (60.0, -1.0, 9, "false"),
        (60.0, 3.0, -1, "false"),
    ],
)
def test_outcomes_without_a_conflict(gap: float, closing: float, leader: int, outcome: str) -> None:
    levels = np.zeros(100, int)
    levels[20:30] = 2
    conflicts, warnings = play(np.full(100, gap), closing, levels, leader)
    assert not conflicts
    assert [w["outcome"] for w in warnings] == [outcome, outcome]


@pytest.mark.parametrize(("braking", "outcome"), [(4.0, "nuisance"), (1.0, "false")])
def test_a_body_ahead_that_brakes_hard_makes_a_warning_a_nuisance(braking: float, outcome: str) -> None:
    """It is 2 m/s faster, and slower by `braking` a second: the gap of 60 m, of 2.4 s, still opens."""
    book = ConflictBook()
    for k in range(10):
        ahead = leaders(9, 60.0, -2.0 + 0.1 * braking * min(k, 4))
        warned = np.array([int(k >= 3)])
        ones = np.array([True]), np.array([25.0]), warned, np.array([np.inf]), lambda i: NOWHERE
        book.add(round(0.1 * k, 1), np.array([4]), ahead, nobody(1), ahead if k > 2 else nobody(1), *ones)
    _, (warning,) = book.settle(np.inf, True)
    assert warning["outcome"] == outcome


@pytest.mark.parametrize(("start", "outcome"), [(14, "nuisance"), (15, "false")])
def test_an_approach_justifies_a_warning_for_half_a_second(start: int, outcome: str) -> None:
    closing = np.where(np.arange(60) < 10, 3.0, -1.0)  # the last approach is at 0.9 s
    levels = np.zeros(60, int)
    levels[start : start + 10] = 1
    _, (warning,) = play(np.full(60, 60.0), closing, levels)
    assert warning["outcome"] == outcome


@pytest.mark.parametrize(("pause", "conflicts"), [(9, 1), (12, 2)])
def test_a_pause_of_a_second_ends_a_conflict(pause: int, conflicts: int) -> None:
    gaps = np.full(100, 12.0)
    gaps[40 : 40 + pause] = 50.0
    found, _ = play(gaps, 5.0, np.zeros(100, int))
    assert len(found) == conflicts


@pytest.mark.parametrize(
    ("begin", "end", "outcome", "warned", "lead"),
    [
        (0.5, 0.9, "nuisance", False, None),  # 4 s before the conflict, which begins at 5.1 s
        (2.0, 2.3, "true", False, None),  # but 4 s before the decisive time, 6.1 s
        (1.0, 5.0, "true", False, None),  # ends more than a second before it
        (1.0, 5.2, "true", True, 5.1),
        (6.2, 6.5, "true", False, -0.1),
        (7.4, 7.8, "true", False, -1.3),  # half a second after the conflict's end at 7.0 s
        (7.7, 7.9, "nuisance", False, None),
    ],
)
def test_which_reminders_belong_to_a_conflict(
    begin: float, end: float, outcome: str, warned: bool, lead: float | None
) -> None:
    t = np.arange(150) / 10
    (row,), (warning,) = play(closing_in(), 5.0, ((t >= begin - 1e-9) & (t <= end + 1e-9)).astype(int))
    assert warning["outcome"] == outcome
    assert row["warned"] == warned
    assert row["lead_time_s"] == (None if lead is None else pytest.approx(lead))


def test_short_pause_does_not_split_a_conflict_and_hidden_leaders_are_told() -> None:
    gaps = np.full(100, 12.0)
    gaps[40:45] = 50.0
    (row,), _ = play(gaps, 5.0, np.zeros(100, int), visible=False)
    assert (row["start_s"], row["end_s"]) == (0.0, pytest.approx(9.9))
    assert row["visible_s"] == 0.0
    assert row["critical_s"] is None


def test_rows_fit_the_table() -> None:
    conflicts, _ = play(closing_in(), 5.0, np.zeros(150, int))
    recorder = Recorder("run", tables={"conflicts": TABLES["conflicts"]})
    recorder.append("conflicts", event_columns("conflicts", conflicts, lambda handle: f"car {handle}"))
    table = recorder.table("conflicts")
    assert table["vehicle_id"].tolist() == ["car 4"]
    assert table["target_id"].tolist() == ["car 9"]
    assert table["lead_time_s"].isna().all()


def test_in_view() -> None:
    objects = objects_at([[{"forward_m": 30.0, "left_m": 0.0}], [{"forward_m": 30.0, "left_m": 0.0}]], 2)
    share = np.array([[0.5, np.nan], [0.01, np.nan]])
    assert in_view(objects, share, np.array([1, 1])).tolist() == [True, False]
    assert in_view(objects, share, np.array([7, -1])).tolist() == [False, False]


@pytest.mark.parametrize(
    ("beside", "overlaps"),
    [
        ({"forward_m": 34.5}, True),  # 4.6 m long each
        ({"forward_m": 34.7}, False),
        ({"left_m": 1.7}, True),  # 1.8 m wide each
        ({"left_m": 1.9}, False),
        ({"left_m": 2.2, "heading_rad": 0.5}, True),
        ({"forward_m": 33.4, "left_m": 3.1, "heading_rad": 0.7854}, False),  # parted by its own rear alone
        ({"handle": -5}, False),  # a post
    ],
)
def test_a_leader_that_another_vehicle_overlaps(beside: dict[str, float], overlaps: bool) -> None:
    leader = {"handle": 3, "forward_m": 30.0, "left_m": 0.0}
    objects = objects_at([[leader, {**leader, "handle": 8, **beside}]])
    assert overlapped(objects, np.array([3])).tolist() == [overlaps]
    assert overlapped(objects, np.array([-1])).tolist() == [False]


def straight_road(heading_rad: float = 0.0, speed_mps: float = 30.0) -> tuple:
    """One vehicle (EgoTruth) 0.2 m left of the middle of a lane of 3.75 m, and the road (RoadTable)."""
    from sumo_net.ego import EgoTruth
    from sumo_net.road_table import MAX_BORDERS, RoadTable

    count = 401
    zeros, x = np.zeros(count), np.arange(float(count))
    table = RoadTable(
        *(np.array([v]) for v in (0, count)), *(np.array([v]) for v in (1.0, 0.0, 400.0, 400.0)),
        np.array([0]), np.array([1]), x, zeros, zeros, zeros,
        np.zeros(1), np.zeros(1), np.ones(1), np.full((1, MAX_BORDERS), np.nan),
        np.zeros((1, MAX_BORDERS), np.int8), np.zeros(1), np.zeros(1),
    )  # fmt: skip
    one = np.zeros(1)
    truth = EgoTruth(
        np.array([3]), np.zeros(1, np.int32), one + 100.0, one + 0.2, one + heading_rad,
        one + 100.0, one + 0.2, one + heading_rad,
        one + speed_mps, one, one, one, one, one, one + 0.2, one + heading_rad, one + 3.75,
        np.zeros(1, np.int32), *(np.zeros(1, np.int8) for _ in range(4)), np.ones(1, bool),
    )  # fmt: skip
    return truth, table


def test_leader_by_place() -> None:
    """A body that reaches into the lane counts, though SUMO may have it elsewhere; one beside does not."""
    truth, table = straight_road()
    beside = {"forward_m": 40.0, "left_m": 3.6, "handle": 5}
    leader = {"forward_m": 80.0, "left_m": -0.2, "handle": 6, "speed_mps": 20.0, "length_m": 14.0}
    cutting_in = {"forward_m": 60.0, "left_m": 2.0, "handle": 7, "speed_mps": 28.0}
    found = path_leaders(truth, objects_at([[beside, leader]]), table, 1.6)
    assert found.handle.tolist() == [6]
    assert found.gap_m[0] == pytest.approx(80.0 - 7.0 - 1.6)
    assert found.ttc_s[0] == pytest.approx((80.0 - 7.0 - 1.6) / 10.0)
    found = path_leaders(truth, objects_at([[beside, leader, cutting_in]]), table, 1.6)
    assert found.handle.tolist() == [7]
    assert path_leaders(truth, objects_at([[beside]]), table, 1.6).handle.tolist() == [-1]
    as_fast = leader | {"speed_mps": 30.0 - 1e-9}
    assert path_leaders(truth, objects_at([[as_fast]]), table, 1.6).ttc_s[0] == np.inf


@pytest.mark.parametrize(("heading", "found"), [(0.0, -1), (0.03, -1), (0.06, 5), (-0.06, -1)])
def test_body_warned_of_in_the_lane_that_is_reached_within_a_second(heading: float, found: int) -> None:
    """The border is 1.675 m to the left: at 30 m/s and 0.06 rad it is reached, at 0.03 rad it is not."""
    truth, table = straight_road(heading)
    left = 3.6 * np.cos(heading) - 40.0 * np.sin(heading)
    beside = {"forward_m": 40.0 + 3.6 * np.sin(heading), "left_m": left, "handle": 5, "speed_mps": 20.0}
    nearer = {"forward_m": 20.0, "left_m": -20.0 * np.sin(heading), "handle": 6}
    target = warned_of(truth, objects_at([[nearer, beside]]), table, np.array([5]), 1.6, 0.3, 1.0)
    assert target.handle.tolist() == [found]
    if found == 5:
        assert target.closing_mps[0] == pytest.approx(10.0, abs=0.1)


def test_leader_by_place_is_the_one_that_projecting_every_body_finds() -> None:
    """In a bend of 80 m: against the search without the quick rejection, over random bodies."""
    from sumo_net.ego import EgoTruth
    from sumo_net.road_kernels import project
    from sumo_net.road_table import MAX_BORDERS, RoadTable

    count, radius = 301, 80.0
    turn = np.arange(float(count)) / radius
    x, y = radius * np.sin(turn), radius * (1.0 - np.cos(turn))
    table = RoadTable(
        *(np.array([v]) for v in (0, count)), *(np.array([v]) for v in (1.0, 0.0, 300.0, 300.0)),
        np.array([0]), np.array([1]), x, y, turn, np.full(count, 1.0 / radius),
        np.zeros(1), np.zeros(1), np.ones(1), np.full((1, MAX_BORDERS), np.nan),
        np.zeros((1, MAX_BORDERS), np.int8), np.zeros(1), np.zeros(1),
    )  # fmt: skip
    one = np.zeros(1)
    truth = EgoTruth(
        np.array([3]), np.zeros(1, np.int32), one, one, one, one, one, one,
        one + 20.0, one, one, one, one, one, one, one, one + 3.75,
        np.zeros(1, np.int32), *(np.zeros(1, np.int8) for _ in range(4)), np.ones(1, bool),
    )  # fmt: skip
    draw = np.random.default_rng(4)
    found_any = 0
    for _ in range(300):
        bodies = [
            {"forward_m": float(f), "left_m": float(left), "handle": k, "speed_mps": 5.0}
            for k, (f, left) in enumerate(zip(draw.uniform(5, 75, 8), draw.uniform(-10, 80, 8), strict=True))
        ]
        objects = objects_at([bodies])
        near, who = np.inf, -1
        for m, body in enumerate(bodies):
            s, d = project(table, 0, body["forward_m"], body["left_m"], body["forward_m"])
            half = 0.5 * float(objects.width_m[0, m])
            straight = abs(body["left_m"]) <= half + 0.9 and body["forward_m"] <= 40.0
            gap = s - 1.6 - 0.5 * float(objects.length_m[0, m])
            ahead = body["forward_m"] - 1.6 - 0.5 * float(objects.length_m[0, m])
            if (straight or abs(d) <= 0.5 * 3.75 + half - 0.3) and ahead < near and gap < near:
                near, who = gap, body["handle"]
        found = path_leaders(truth, objects, table, 1.6)
        assert found.handle.tolist() == [who]
        found_any += who >= 0
    assert found_any > 50
