"""Scenario files as tests: collected by pytest, with what is wrong and where to look."""

import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

from analysis.regression import _bounds, check, worst_moment
from sumo_net.scenario import scenario_mapping
from sumo_net.settings import SettingsError

SHORT = """scenario = "straight"
seeds = [2]
[settings]
duration_s = 2.0
warm_up_s = 1.0
equipment.fraction = 0.05
"""


def written(folder: Path, name: str, text: str) -> Path:
    file = folder / f"{name}.scenario.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_bounds_may_be_nested_or_dotted() -> None:
    expect = {
        "departures": {"missed": 0},
        "tlc": {"error_p95_s": {"max": 0.2}},
        "class_accuracy": {"min": 0.9},
    }
    assert dict(_bounds(expect)) == {
        "departures.missed": {"is": 0.0},
        "tlc.error_p95_s": {"max": 0.2},
        "class_accuracy": {"min": 0.9},
    }
    with pytest.raises(SettingsError, match="must be a number"):
        dict(_bounds({"a": "b"}))


def test_settings_lie_over_the_scenario_that_is_named(tmp_path: Path) -> None:
    file = written(tmp_path, "a", SHORT)
    mapping, path = scenario_mapping(str(file))
    assert path == file
    assert mapping["duration_s"] == 2.0
    assert mapping["title"].startswith("Straight") or "straight" in mapping["title"].lower()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seed = [1]", "seed"),
        ("seeds = []", "seeds"),
        ('scenario = "straigth"', "straight"),
        ("[settings]\ndurations_s = 3", "duration_s"),
        ("[expect]\na = true", "must be a number"),
        ("", "expects nothing"),
        ("[expect]", "expects nothing"),
        ("[expect]\ndepartures.mised = 0", "did you mean departures_missed"),
        ('[golden]\nfigures = ["departures.mised"]', "golden.figures: departures.mised"),
    ],
)
def test_a_file_that_is_wrong_is_told_before_anything_runs(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        check(written(tmp_path, "a", text))


def test_the_worst_moment_is_where_one_would_look() -> None:
    steps = pd.DataFrame(
        {
            "run_id": "highway-7",
            "vehicle_id": ["a", "b"],
            "time_s": [1.0, 2.0],
            "lateral_offset_m": [0.0, 1.0],
            "true_lateral_offset_m": [0.1, 0.2],
        }
    )
    assert worst_moment("lateral_offset_rmse_m", {"steps": steps}) == ("highway-7", "b", 2.0)
    assert worst_moment("distance_km", {"steps": steps}) is None


def test_pytest_collects_runs_and_explains(tmp_path: Path) -> None:
    written(tmp_path, "good", SHORT + "[expect]\nvehicles.min = 1\n[golden]\nfigures = ['distance_km']\n")
    written(tmp_path, "bad", SHORT + "[expect]\nlateral_offset_rmse_m.max = 0.0\nnonsense = 3\n")
    written(tmp_path, "worse still", SHORT + "[expect]\nlateral_offset_rmse_m.max = 0.0\n")

    def run(*options: str) -> subprocess.CompletedProcess[str]:
        # the plug-in is an entry point of the installed package; -p does no harm where it is
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path), *options]
        return subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)

    done = run("--adas-update", "-n", "2", f"--junitxml={tmp_path}/report.xml")
    assert "1 passed" in done.stdout
    assert "2 failed" in done.stdout
    assert "lateral_offset_rmse_m is" in done.stdout
    assert "worst: run worse still-2 vehicle" in done.stdout
    line = f"see it: sumo-adas run '{tmp_path}/worse still.scenario.toml' --seed 2 --out 'out/worse still'"
    assert line in done.stdout
    assert "there is no such figure" in done.stdout
    assert (tmp_path / "good.scenario.golden.json").exists()
    assert 'tests="3"' in (tmp_path / "report.xml").read_text()
    golden = tmp_path / "good.scenario.golden.json"
    golden.write_text(golden.read_text().replace(": ", ": 9"))
    done = run("-k", "good")
    assert "1 failed" in done.stdout
    assert "golden" in done.stdout
