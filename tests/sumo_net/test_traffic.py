"""The coupling with a real SUMO: a straight road of two edges with three lanes, 33 m/s."""

import subprocess
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import sumo

from sumo_net.traffic import Traffic, TrafficError

BIN = Path(sumo.SUMO_HOME) / "bin"
ROUTES = """
<routes>
  <vType id="car" length="4.2" width="1.75" height="1.5" sigma="0" speedDev="0" maxSpeed="40"/>
  <vType id="truck" vClass="truck" length="14" width="2.5" height="3.8" sigma="0" speedDev="0"/>
  <route id="through" edges="ab bc"/>
  <vehicle id="ego" type="car" route="through" depart="0" departPos="100" departLane="1" departSpeed="20"/>
  <vehicle id="lorry" type="truck" route="through" depart="0" departPos="40" departLane="0" departSpeed="10"/>
  <flow id="more" type="car" route="through" begin="1" end="50" period="2" departLane="2" departSpeed="30"/>
</routes>
"""


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with right.net.xml, left.net.xml (traffic keeps left) and routes.rou.xml."""
    folder = tmp_path_factory.mktemp("road")
    (folder / "n.nod.xml").write_text(
        '<nodes><node id="a" x="0" y="0"/><node id="b" x="600" y="0"/><node id="c" x="1000" y="0"/></nodes>'
    )
    edge = '<edge id="{0}{1}" from="{0}" to="{1}" numLanes="3" speed="33"/>'
    (folder / "n.edg.xml").write_text(f"<edges>{edge.format('a', 'b')}{edge.format('b', 'c')}</edges>")
    (folder / "routes.rou.xml").write_text(ROUTES)
    for name, more in (("right", []), ("left", ["--lefthand"])):
        command = [str(BIN / "netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml", "-o", f"{name}.net.xml"]
        subprocess.run([*command, *more], cwd=folder, check=True, capture_output=True)
    return folder


def arguments(road: Path, net: str = "right", step: str = "0.1", routes: str = "routes.rou.xml") -> list[str]:
    words = f"-n {road / net}.net.xml --route-files {road / routes} --step-length {step} --no-step-log true"
    return [*words.split(), "--no-warnings", "true"]


@pytest.fixture
def start(road: Path) -> Iterator[Callable[..., Traffic]]:
    started: list[Traffic] = []

    def begin(net: str = "right", *more: str, routes: str = "routes.rou.xml") -> Traffic:
        started.append(Traffic.start([*arguments(road, net, routes=routes), *more]))
        return started[-1]

    yield begin
    for traffic in started:
        traffic.close()


def run(traffic: Traffic, steps: int) -> None:
    for _ in range(steps):
        traffic.step()
        traffic.snapshot()


def test_snapshot_is_what_one_can_compute_by_hand(start: Callable[..., Traffic]) -> None:
    traffic = start()
    traffic.step()
    first = traffic.snapshot()
    ego = list(first.handle).index(traffic.handle("ego"))
    assert first.heading_rad[ego] == pytest.approx(0.0, abs=1e-12)  # eastwards
    assert first.y_m[ego] == pytest.approx(-4.8)  # middle one of three lanes of 3.2 m right of the axis
    assert (first.length_m[ego], first.width_m[ego], first.height_m[ego]) == (4.2, 1.75, 1.5)
    assert traffic.lane_ids[first.lane[ego]] == "ab_1"
    assert traffic.vehicle_class(first.handle[ego]) == "passenger"
    traffic.step()
    second = traffic.snapshot()
    assert traffic.time_s == pytest.approx(0.2)
    driven = second.x_m - first.x_m
    assert driven == pytest.approx(second.speed_mps * 0.1)  # SUMO's Euler step
    acceleration = traffic.accelerations_mps2(second.handle)
    assert acceleration == pytest.approx((second.speed_mps - first.speed_mps) / 0.1)
    assert second.lane_position_m == pytest.approx(second.x_m)


def test_rows_are_in_order_of_handles_and_columns_typed(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 100)
    snapshot = traffic.snapshot()
    assert len(snapshot.handle) == 7
    assert (np.diff(snapshot.handle) > 0).all()
    assert snapshot.handle.dtype == np.int64
    assert snapshot.lane.dtype == np.int32
    assert all(part.dtype == np.float64 and part.flags.c_contiguous for part in snapshot[1:5])
    assert [traffic.handle(traffic.vehicle_id(h)) for h in snapshot.handle] == list(snapshot.handle)


def lateral(traffic: Traffic, handle: int) -> float:
    """SUMO's place across the lane, left positive."""
    place: float = traffic._sumo.vehicle.getLateralLanePosition(traffic.vehicle_id(handle))
    return -place if traffic.left_hand else place


@pytest.mark.parametrize("net", ["right", "left"])
def test_lateral_position_is_left_positive_and_exact(start: Callable[..., Traffic], net: str) -> None:
    traffic = start(net)
    assert traffic.left_hand == (net == "left")
    run(traffic, 5)
    before = traffic.snapshot()
    wanted = np.array([0.7, -0.4])
    traffic.write_lateral(before.handle[:2], wanted)
    traffic.step()
    after = traffic.snapshot()
    assert [lateral(traffic, handle) for handle in after.handle[:2]] == pytest.approx(wanted)
    assert after.y_m[:2] - before.y_m[:2] == pytest.approx(wanted)  # eastwards: left is +y
    assert (after.lane == before.lane).all()


def test_a_lateral_position_that_is_not_finite_is_refused(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 2)
    handle = np.array([traffic.handle("ego")])
    with pytest.raises(ValueError, match="'ego' is not finite"):
        traffic.write_lateral(handle, np.array([np.nan]))


def test_vehicles_that_have_vanished_are_passed_over(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 5)
    ego, lorry = traffic.handle("ego"), traffic.handle("lorry")
    traffic._sumo.vehicle.remove("ego")
    traffic.write_lateral(np.array([ego, lorry]), np.array([0.5, 0.5]))
    traffic.set_color(ego, 255, 0, 0)
    traffic.step()
    snapshot = traffic.snapshot()
    assert ego not in snapshot.handle
    assert lateral(traffic, lorry) == pytest.approx(0.5)
    assert traffic.route_ahead(ego) == ()
    assert traffic.vehicle_parameter(ego, "adas.equipped") == ""
    assert traffic.vehicle_id(ego) == "ego"
    with pytest.raises(KeyError):
        traffic.handle("ego")


def test_a_handle_is_never_used_again(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 5)
    before = traffic.handle("ego")
    traffic._sumo.vehicle.remove("ego")
    run(traffic, 2)
    traffic._sumo.vehicle.add("ego", "through", typeID="truck", departPos="300", departLane="1")
    run(traffic, 2)
    snapshot = traffic.snapshot()
    after = traffic.handle("ego")
    assert after > before
    assert snapshot.length_m[list(snapshot.handle).index(after)] == 14.0


def test_route_ahead_follows_the_vehicle_and_a_new_route(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 5)
    ego = traffic.handle("ego")
    assert traffic.route_ahead(ego) == ("ab", "bc")
    traffic._sumo.vehicle.setRoute("ego", ["ab"])
    assert traffic.route_ahead(ego) == ("ab",)
    traffic._sumo.vehicle.setRoute("ego", ["ab", "bc"])
    traffic._sumo.vehicle.moveTo("ego", "bc_1", 50.0)
    run(traffic, 2)
    assert traffic.route_ahead(ego) == ("bc",)


def test_parked_and_teleporting_vehicles(start: Callable[..., Traffic]) -> None:
    traffic = start()
    run(traffic, 5)
    ego, vehicle = traffic.handle("ego"), traffic._sumo.vehicle
    vehicle.setStop("ego", "ab", pos=400.0, laneIndex=1, flags=1, duration=5.0)
    vehicle.moveTo("ego", "ab_1", 395.0)
    vehicle.setSpeed("ego", 3.0)
    parked = 0
    for _ in range(120):
        traffic.step()
        snapshot = traffic.snapshot()
        row = list(snapshot.handle).index(ego)
        if snapshot.lane[row] == -1:
            parked += 1
            assert np.isfinite(snapshot.x_m[row])
            assert np.isnan(snapshot.lane_position_m[row])
        assert np.isfinite(traffic.accelerations_mps2(snapshot.handle)).all()
    assert parked > 20
    assert snapshot.lane[row] >= 0  # drives again, under the same handle


def test_a_teleport_takes_the_vehicle_out_and_back(start: Callable[..., Traffic], road: Path) -> None:
    # A stop with `jump`: after it the vehicle is nowhere for 5 s, then at the next stop.
    stops = (
        '<stop lane="ab_1" endPos="200" duration="1" jump="5"/><stop lane="bc_1" endPos="100" duration="1"/>'
    )
    ego = ROUTES.index('departSpeed="20"/>') + len('departSpeed="20"')
    (road / "jump.rou.xml").write_text(f"{ROUTES[:ego]}>{stops}</vehicle>{ROUTES[ego + 2 :]}")
    traffic = start(routes="jump.rou.xml")
    run(traffic, 5)
    handle = traffic.handle("ego")
    seen = []
    for _ in range(250):
        traffic.step()
        snapshot = traffic.snapshot()
        assert np.isfinite(snapshot.x_m).all()
        traffic.write_lateral(np.array([handle]), np.array([0.1]))
        traffic.route_ahead(handle)
        seen.append(handle in snapshot.handle)
    away = seen.index(False)
    assert away > 50  # drove there and stood
    assert any(seen[away:])  # back under the same handle
    assert sum(not there for there in seen) == pytest.approx(50, abs=3)


def test_libsumo_and_traci_see_the_same(road: Path) -> None:
    import sumolib
    import traci
    from traci import constants as tc

    traci.start([sumolib.checkBinary("sumo"), *arguments(road)], label="same", stdout=subprocess.DEVNULL)
    connection = traci.getConnection("same")
    try:
        with Traffic.start(arguments(road)) as inside:
            outside = Traffic.attach(connection)
            connection.simulationStep()
            connection.vehicle.subscribe("ego", [tc.VAR_ROAD_ID])  # the user's own is left alone
            inside.step()
            assert outside.lane_ids == inside.lane_ids
            for step in range(60):
                inside.step()
                outside.step()
                one, other = inside.snapshot(), outside.snapshot()
                for name, a, b in zip(one._fields, one, other, strict=True):
                    assert a.dtype == b.dtype
                    np.testing.assert_array_equal(a, b, err_msg=f"step {step}, {name}")
                lateral = 0.3 * np.sin(one.handle + step)
                assert connection.vehicle.getSubscriptionResults("ego")[tc.VAR_ROAD_ID] == "ab"
                for traffic in (inside, outside):
                    traffic.write_lateral(one.handle, lateral)
                    assert all(traffic.route_ahead(h) for h in one.handle)
    finally:
        connection.close()
    with pytest.raises(TrafficError, match="SUMO stopped"):
        outside.step()
    with pytest.raises(TrafficError, match="SUMO stopped"):
        outside.snapshot()


def test_attach_to_the_users_libsumo_and_leave_it_running(road: Path) -> None:
    import libsumo

    with pytest.raises(TrafficError, match=r"not running.*--step-length"):
        Traffic.attach(libsumo)
    libsumo.start(["sumo", *arguments(road)])
    try:
        with Traffic.attach(libsumo) as traffic:
            libsumo.simulationStep()
            assert len(traffic.snapshot().handle) == 2
            with pytest.raises(TrafficError, match="already running"):
                Traffic.start(arguments(road))
        assert libsumo.isLoaded()
    finally:
        libsumo.close()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--step-length", "1"], "step length is 1 s, needed is 0.1 s: add --step-length 0.1"),
        (["--lateral-resolution", "0.5"], "add --lateral-resolution -1"),
        (["--lanechange.duration", "3"], "add --lanechange.duration 0"),
        (["--begin", "soon"], "soon"),
        (["--route-files", "late.rou.xml"], "vehicle type 'none'"),
        (["--nonsense", "1"], "No option with the name 'nonsense'"),
        (["--additional-files", "nowhere.add.xml"], "'nowhere.add.xml' is not accessible"),
    ],
)
def test_a_start_that_cannot_work_says_why_in_one_line(road: Path, options: list[str], words: str) -> None:
    given = arguments(road)
    late = '<routes><vehicle id="v" type="none" depart="0"><route edges="ab"/></vehicle></routes>'
    (road / "late.rou.xml").write_text(late)
    options = [str(road / word) if word == "late.rou.xml" else word for word in options]
    if options[0] in given:
        at = given.index(options[0])
        given[at : at + 2] = []
    with pytest.raises(TrafficError) as refused:
        Traffic.start([*given, *options])
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
    with Traffic.start(arguments(road)) as traffic:  # and the process can still start one
        traffic.step()


def test_one_simulation_a_process(start: Callable[..., Traffic], road: Path) -> None:
    traffic = start()
    with pytest.raises(TrafficError, match="already running"):
        Traffic.start(arguments(road))
    traffic.step()
    assert len(traffic.snapshot().handle) == 2


def test_close_completes_sumos_own_outputs_and_can_be_called_twice(road: Path, tmp_path: Path) -> None:
    output = tmp_path / "fcd.xml"
    traffic = Traffic.start([*arguments(road), "--fcd-output", str(output)])
    run(traffic, 20)
    traffic.close()
    traffic.close()
    assert len(ET.parse(output).getroot()) == 20
    with pytest.raises(TrafficError, match="SUMO stopped"):
        traffic.step()


def test_a_window_is_a_simulation_in_its_own_process(road: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Without a screen: the same program without its window.
    monkeypatch.setattr("sumolib.checkBinary", lambda _: str(BIN / "sumo"))
    with Traffic.start(arguments(road), gui=True) as traffic:
        run(traffic, 10)
        snapshot = traffic.snapshot()
        traffic.set_color(traffic.handle("ego"), 255, 0, 0)
        with pytest.raises(TrafficError, match="already running"):
            Traffic.start(arguments(road))
    with Traffic.start(arguments(road)) as inside:
        run(inside, 10)
        np.testing.assert_array_equal(inside.snapshot().x_m, snapshot.x_m)


def test_a_window_that_cannot_open_says_so_at_once(road: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sumolib.checkBinary", lambda _: str(BIN / "sumo"))
    began = time.monotonic()
    with pytest.raises(TrafficError, match=r"did not start: .*'none.net.xml' is not accessible"):
        Traffic.start(["-n", "none.net.xml", "--step-length", "0.1"], gui=True)
    assert time.monotonic() - began < 20
