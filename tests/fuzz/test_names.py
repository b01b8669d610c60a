"""Vehicle and file names with paths or markup: everything is written into the output directory."""

import json
from collections.abc import Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from analysis.report import write_report
from analysis.simulate import simulate
from benchmarks.road_networks import NETWORKS
from plugin.record import read_table
from sumo_net.traffic import TrafficError

VEHICLES = (
    "../../../evil",
    "/tmp/sumo-adas-evil",
    "a/b/..",
    "é✗𝔘\u202e",
    "x" * 300,
    "%s{0}$(id)`id`",
    "..",
    "NUL",
    "-rf",
    "#",
)
FILE = "<img src=x onerror=alert(1)>' $(touch evil) \u202eé.sumocfg"


def write_scenario(place: Path, vehicles: Sequence[str]) -> Path:
    """A configuration with a hostile name and a trip for each of the vehicles."""
    place.mkdir(parents=True)
    NETWORKS["short"](place / "a.net.xml")
    trips = [
        f'<trip id={quoteattr(name)} depart="0" from="{"e0" if k % 2 else "e6_back"}"'
        f' to="{"e6" if k % 2 else "e0_back"}" departLane="free" departPos="random_free"/>'
        for k, name in enumerate(vehicles)
    ]
    (place / "a.rou.xml").write_text(f"<routes>{''.join(trips)}</routes>", encoding="utf-8")
    (place / FILE).write_text(
        '<configuration><net-file value="a.net.xml"/><route-files value="a.rou.xml"/></configuration>'
    )
    return place / FILE


def test_names(tmp_path: Path) -> None:
    file = write_scenario(tmp_path / "deep" / "in" / "folders", VEHICLES)
    before = set(tmp_path.rglob("*"))
    out = tmp_path / "out"
    changes = {"recording": {"frames": 20}}
    simulate(str(file), out, duration_s=4.0, fraction=1.0, quiet=True, threads=1, changes=changes)
    assert set(read_table(out, "steps")["vehicle_id"]) == set(VEHICLES)
    page = write_report(out, None, frames=True)
    made = set(tmp_path.rglob("*")) - before
    assert all(out == path or out in path.parents for path in made)
    assert not Path("/tmp/sumo-adas-evil").exists()
    owners = [json.loads(file.read_text())["vehicle_id"] for file in out.glob("frames/*/vehicle.json")]
    assert sorted(owners) == sorted(VEHICLES)
    assert "<img src=x onerror" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["a\nb", "<img src=x onerror=alert(1)>", "a\x9b31m b\u202e"])
def test_names_that_sumo_refuses_cannot_steer_a_terminal(tmp_path: Path, name: str) -> None:
    file, out = write_scenario(tmp_path / "in", [name]), tmp_path / "out"
    with pytest.raises(TrafficError, match="Invalid trip id") as error:
        simulate(str(file), out, duration_s=1.0, fraction=1.0, quiet=True, threads=1)
    assert str(error.value).isprintable()
    assert all(
        path == out or out in path.parents
        for path in tmp_path.rglob("*")
        if file.parent not in [path, *path.parents]
    )
