"""Scenarios, prepared and run in a real SUMO."""

import gzip
import hashlib
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import sumo

from plugin.configuration import load_configuration
from sumo_net.configuration import seconds
from sumo_net.equipment import EquipmentChoice
from sumo_net.network import BuiltNetwork
from sumo_net.scenario import (
    PreparedRun,
    Scenario,
    list_scenarios,
    prepare,
    scenario_files,
)
from sumo_net.settings import SettingsError, read
from sumo_net.traffic import Snapshot, Traffic

BIN = Path(sumo.SUMO_HOME) / "bin"
BOLOGNA = Path(__file__).parents[3] / "shared" / "data" / "bologna_pasubio"


def drive(run: PreparedRun, steps: int) -> Snapshot:
    with Traffic.start(run.arguments) as traffic:
        for _ in range(steps):
            traffic.step()
        return traffic.snapshot()


def user_files(folder: Path) -> Path:
    """A user's scenario in a folder of its own; it has a detector, and outputs beside itself."""
    folder.mkdir(exist_ok=True)
    (folder / "n.nod.xml").write_text(
        '<nodes><node id="a" x="0" y="0"/><node id="b" x="500" y="0"/><node id="c" x="900" y="200"/></nodes>'
    )
    (folder / "n.edg.xml").write_text(
        '<edges><edge id="ab" from="a" to="b" numLanes="2" speed="25"/>'
        '<edge id="bc" from="b" to="c" numLanes="2" speed="25"/></edges>'
    )
    command = [str(BIN / "netconvert"), "-n", "n.nod.xml", "-e", "n.edg.xml", "-o", "town.net.xml"]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (folder / "cars.rou.xml").write_text(
        '<routes><vType id="v"><param key="has.adas.device" value="true"/></vType>'
        '<flow id="f" type="v" begin="5" end="99" period="2"><route edges="ab bc"/></flow></routes>'
    )
    (folder / "inner.add.xml").write_text(
        '<additional><e1Detector id="d2" lane="ab_1" pos="20" period="1" file="results/d2.xml"/></additional>'
    )
    (folder / "more.add.xml").write_text(
        '<additional><e1Detector id="d1" lane="ab_0" pos="20" period="1" file="d1.xml"/>'
        '<edgeData id="e" file="NUL"/><include href="inner.add.xml"/></additional>'
    )
    (folder / "town.sumocfg").write_text(
        '<configuration><input><n value="town.net.xml"/><route-files value="cars.rou.xml"/>'
        '<additional value="more.add.xml"/></input><output><summary value="s.xml"/>'
        '<output-prefix value="mine_"/><tripinfo-output value="trips/t.xml"/></output>'
        '<time><begin value="0:00:05"/><end value="7"/><step-length value="0.5"/></time>'
        '<processing><lateral-resolution value="0.8"/></processing><report><log value="l.txt"/></report>'
        "</configuration>"
    )
    return folder / "town.sumocfg"


def contents(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


# --- built-in scenarios


def test_the_default_scenario_comes_first_and_all_have_titles() -> None:
    listed = list_scenarios()
    names = [name for name, _ in listed]
    assert names[0] == "highway"
    assert names[1:] == sorted(names[1:])
    assert {"conflicts", "curves", "dense", "radius_250", "s_curve", "straight"} <= set(names)
    assert all(title for _, title in listed)
    assert all(load_configuration(name).purpose for name in names)


@pytest.mark.parametrize("name", list(scenario_files()))
def test_built_in_scenarios_load_and_start(name: str, tmp_path: Path) -> None:
    scenario = load_configuration(name)
    assert scenario.purpose
    run = prepare(scenario, tmp_path)
    assert isinstance(run.network, BuiltNetwork)
    snapshot = drive(run, run.warm_up_steps)
    assert len(snapshot.handle) > 80
    assert (snapshot.lane >= 0).all()
    assert np.isfinite(np.stack(snapshot[1:6])).all()


def test_the_default_has_a_full_road_both_ways_and_enough_equipped_cars(tmp_path: Path) -> None:
    scenario = load_configuration("highway")
    run = prepare(scenario, tmp_path)
    assert run.recorded_steps == 1200
    with Traffic.start(run.arguments) as traffic:
        for _ in range(run.warm_up_steps):
            traffic.step()
        snapshot = traffic.snapshot()
        names = [traffic.vehicle_id(h) for h in snapshot.handle]
        equipped = EquipmentChoice(scenario.equipment, scenario.seed).choose(traffic, list(snapshot.handle))
    assert len(equipped) >= 20
    for direction in ("forward", "backward"):
        there = np.array([name.startswith(direction) for name in names])
        lanes = {name.split(".")[0].split("_")[1] for name in np.array(names)[there]}
        assert lanes == {"0", "1", "2"}
        # 900 vehicles an hour and lane at about 30 m/s: 8 a kilometre and lane, on 4.5 km
        assert there.sum() == pytest.approx(110, rel=0.2)
    lengths = set(np.round(snapshot.length_m, 1))
    assert lengths == {4.2, 6.0, 14.0}


def test_the_mix_is_what_was_asked_for(tmp_path: Path) -> None:
    mapping = {"demand": {"truck": {"share": 0.2}, "van": {"share": 0.3}, "flow_per_lane_vph": 1200.0}}
    snapshot = drive(prepare(read(Scenario, mapping, "x"), tmp_path), 100)
    share = {length: np.mean(snapshot.length_m == length) for length in (4.2, 6.0, 14.0)}
    assert share[14.0] == pytest.approx(0.2, abs=0.08)
    assert share[6.0] == pytest.approx(0.3, abs=0.09)


def test_no_traffic_the_other_way(tmp_path: Path) -> None:
    mapping = {"demand": {"backward_flow_per_lane_vph": 0.0}}
    run = prepare(read(Scenario, mapping, "x"), tmp_path)
    text = (tmp_path / "demand.rou.xml").read_text()
    assert 'id="forward_0"' in text
    assert 'id="backward_0"' not in text
    assert len(drive(run, 5).handle) > 30


def test_same_seed_same_traffic_and_another_seed_another(tmp_path: Path) -> None:
    one, same, other = (
        drive(prepare(load_configuration("straight", {"seed": seed}), tmp_path / name), 50)
        for name, seed in (("a", 5), ("b", 5), ("c", 6))
    )
    for a, b in zip(one, same, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(one.x_m, other.x_m)
    assert (tmp_path / "a/demand.rou.xml").read_bytes() == (tmp_path / "b/demand.rou.xml").read_bytes()


# --- the user's files


def test_a_users_toml_with_a_network_beside_it(tmp_path: Path) -> None:
    user_files(tmp_path / "mine")
    toml = tmp_path / "mine" / "own.toml"
    toml.write_text('net_file = "town.net.xml"\nduration_s = 20.0\n[demand]\nflow_per_lane_vph = 1800.0\n')
    scenario = load_configuration(str(toml))
    before = contents(tmp_path / "mine")
    run = prepare(scenario, tmp_path / "run")
    assert run.network == (tmp_path / "mine/town.net.xml").resolve()
    assert len(drive(run, 150).handle) > 3
    assert contents(tmp_path / "mine") == before


def test_a_ring_road_has_traffic_too(tmp_path: Path) -> None:
    command = [str(BIN / "netgenerate"), "--grid", "--grid.number", "3", "-o", str(tmp_path / "grid.net.xml")]
    subprocess.run(command, check=True, capture_output=True)
    scenario = load_configuration(str(tmp_path / "grid.net.xml"))
    assert len(drive(prepare(scenario, tmp_path / "run"), 100).handle) > 3


def test_a_users_sumocfg_that_begins_days_later_ends_to_the_step(tmp_path: Path) -> None:
    source = user_files(tmp_path / "mine")
    source.write_text(source.read_text().replace('"0:00:05"', '"604800"'))
    run = prepare(load_configuration(str(source), {"duration_s": 10.3}), tmp_path / "run")
    assert run.begin_s == 604800.0
    assert any("end 7 is overridden by 604810.3" in note for note in run.notes)


def test_a_users_sumocfg_writes_only_into_the_runs_folder(tmp_path: Path) -> None:
    source = user_files(tmp_path / "mine")
    before = contents(tmp_path / "mine")
    scenario = load_configuration(str(source), {"duration_s": 10.0, "seed": 4})
    run = prepare(scenario, tmp_path / "run")
    assert run.network == (tmp_path / "mine/town.net.xml").resolve()
    assert run.begin_s == 5.0
    assert any("step-length 0.5 is overridden by 0.1" in note for note in run.notes)
    assert any("lateral-resolution 0.8 is overridden by -1" in note for note in run.notes)
    assert any("end 7 is overridden by 15" in note for note in run.notes)
    with Traffic.start(run.arguments) as traffic:
        for _ in range(100):
            traffic.step()
        snapshot = traffic.snapshot()
        equipped = EquipmentChoice(scenario.equipment, 4).choose(traffic, list(snapshot.handle))
        assert traffic.time_s == pytest.approx(15.0)
    assert len(equipped) == len(snapshot.handle) == 5  # every 2 s, and all of that type ask for it
    assert contents(tmp_path / "mine") == before
    written = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"s.xml", "t.xml", "d1.xml", "d2.xml", "l.txt"} <= written
    assert len(ET.parse(tmp_path / "run" / "d1.xml").getroot()) >= 8


def test_bologna_with_a_fifth_equipped(tmp_path: Path) -> None:
    if not BOLOGNA.is_dir():
        pytest.skip("no ../shared/data")
    before = {path.name for path in BOLOGNA.iterdir()}
    scenario = load_configuration(str(BOLOGNA / "run.sumocfg"), {"seed": 3})
    run = prepare(scenario, tmp_path)
    choice = EquipmentChoice(scenario.equipment, 3)
    seen, cars, equipped = -1, 0, 0
    with Traffic.start(run.arguments) as traffic:
        for _ in range(600):
            traffic.step()
            snapshot = traffic.snapshot()
            new = [int(handle) for handle in snapshot.handle if handle > seen]
            seen = max([seen, *new])
            cars += sum(traffic.vehicle_class(handle) == "passenger" for handle in new)
            chosen = choice.choose(traffic, new)
            equipped += len(chosen)
            assert all(traffic.route_ahead(handle) for handle in snapshot.handle)
            assert np.isfinite(snapshot.x_m).all()
            traffic.write_lateral(snapshot.handle, 0.2 * np.sin(snapshot.handle.astype(float)))
    assert cars > 100
    assert equipped / cars == pytest.approx(0.2, abs=0.1)
    assert {path.name for path in BOLOGNA.iterdir()} == before
    assert (tmp_path / "tripinfos.xml").is_file()


# --- bad input: one line that says what and where


def refused(source: str, folder: Path) -> str:
    with pytest.raises(SettingsError) as error:
        prepare(load_configuration(source), folder / "run")
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration = 5", "unknown key 'duration': did you mean 'duration_s'?"),
        ("duration_s = -1.0", "duration_s = -1.0: input should be greater than 0"),
        (
            "[demand]\nflow_per_lane = 5",
            "'demand.flow_per_lane': did you mean 'flow_per_lane_vph'?",
        ),
        ("[demand.truck]\nshare = 1.5", "demand.truck.share = 1.5"),
        ("[demand.truck]\nshare = 0.7\n[demand.van]\nshare = 0.7", "together at most 1"),
        ("[equipment]\nfraction = 3", "equipment.fraction = 3"),
        ("[highway]\nlanes = 0", "highway.lanes = 0"),
        ("seed = 'x'", "seed = 'x'"),
        ("= 5", "is not valid TOML"),
        ("net_file = 'nowhere.net.xml'", "nowhere.net.xml: no such file"),
        ("configuration = 'nowhere.sumocfg'", "nowhere.sumocfg: no such file"),
        ("configuration = 'a.sumocfg'\nnet_file = 'b.net.xml'", "name only one"),
    ],
)
def test_a_bad_toml(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "own.toml"
    file.write_text(text)
    message = refused(str(file), tmp_path)
    assert words in message
    if "such file" not in words:
        assert message.startswith(str(file))


def test_names_and_files_that_are_not_there(tmp_path: Path) -> None:
    assert "no scenario 'highwy': did you mean 'highway'?" in refused("highwy", tmp_path)
    assert "built in are highway, conflicts, curves, dense, " in refused("x", tmp_path)
    assert "no such file" in refused(str(tmp_path / "none.toml"), tmp_path)
    assert "no such file" in refused(str(tmp_path / "none.sumocfg"), tmp_path)
    assert "no such file" in refused(str(tmp_path / "none.net.xml"), tmp_path)
    packed, other = tmp_path / "town.sumocfg.gz", tmp_path / "town.xml"
    packed.write_bytes(gzip.compress(user_files(tmp_path).read_bytes()))
    assert "is compressed, as SUMO reads networks and routes, but no configuration" in refused(
        str(packed), tmp_path / "run"
    )
    assert f"{tmp_path}: is a directory; {tmp_path / 'configuration.json'} repeats" in refused(
        str(tmp_path), tmp_path / "run"
    )
    other.write_text("<configuration/>")
    assert f"{other}: a scenario is a .toml, .sumocfg," in refused(str(other), tmp_path / "run")


def test_a_built_in_scenario_is_meant_where_a_folder_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "curves").mkdir()
    assert load_configuration("curves").title == dict(list_scenarios())["curves"]


def test_networks_that_are_none(tmp_path: Path) -> None:
    source = tmp_path / "x.net.xml"
    source.write_text("<net><edge")
    assert "is not a SUMO network" in refused(str(source), tmp_path)
    source.write_text('<net version="1.20"></net>')
    assert "has no lanes" in refused(str(source), tmp_path)
    source.write_text("<routes/>")
    assert "has no lanes" in refused(str(source), tmp_path)
    source.write_text("")
    assert "is not a SUMO network" in refused(str(source), tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("town.net.xml", "gone.net.xml", "gone.net.xml: no such file"),
        ("cars.rou.xml", "gone.rou.xml", "gone.rou.xml: no such file"),
        ('<n value="town.net.xml"/>', "", "names no network"),
        ("</configuration>", "", "SUMO cannot read it"),
        ('"0:00:05"', '"soon"', "begin"),
        ("<n value", "<nett-file value", "No option with the name 'nett-file' exists"),
    ],
)
def test_a_bad_sumocfg(old: str, new: str, words: str, tmp_path: Path) -> None:
    source = user_files(tmp_path / "mine")
    text = source.read_text()
    assert old in text
    source.write_text(text.replace(old, new))
    message = refused(str(source), tmp_path)
    assert words in message
    assert "town.sumocfg" in message


def test_a_broken_additional_file(tmp_path: Path) -> None:
    source = user_files(tmp_path / "mine")
    (tmp_path / "mine" / "more.add.xml").write_text("<additional><e1Detector id=")
    assert "more.add.xml: is not valid XML" in refused(str(source), tmp_path)


def test_a_network_in_the_sumocfg_without_lanes(tmp_path: Path) -> None:
    source = user_files(tmp_path / "mine")
    (tmp_path / "mine" / "town.net.xml").write_text('<net version="1.20"></net>')
    assert "has no lanes" in refused(str(source), tmp_path)


@pytest.mark.parametrize(("text", "value"), [("5", 5.0), ("0:01:30.5", 90.5), ("1:00:00:00", 86400.0)])
def test_times_as_sumo_writes_them(text: str, value: float) -> None:
    assert seconds(text) == value
