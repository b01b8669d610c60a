"""The commands as a user types them: their output, and errors in one line."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numba
import numpy as np
import pandas as pd
import pytest

from analysis.cli import main
from analysis.commands.common import told_of_compiling
from analysis.commands.recordings import LogFormat
from analysis.radar_formats import FORMATS
from plugin.record import read_table
from plugin.schema import TABLES
from plugin.tracking.filters import FILTERS

COMMAND = [sys.executable, "-c", "from analysis.cli import main; main()"]
BOLOGNA = Path(__file__).parents[3] / "shared" / "data" / "bologna_pasubio"
CAMERA = "height_m = 1.3\n"
RADAR = "time_s,range_m,range_rate_mps,azimuth_rad\n" + "".join(
    f"{k / 10},{100.0 - k / 2},-5.0,0.01\n" for k in range(30)
)


def typed(*words: str | Path, timeout_s: float = 120.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *map(str, words)], capture_output=True, text=True, timeout=timeout_s, check=False
    )


@pytest.fixture(autouse=True)
def _handlers() -> Iterator[None]:
    before = signal.getsignal(signal.SIGTERM)
    yield
    signal.signal(signal.SIGTERM, before)


@pytest.fixture(scope="module")
def both_formats(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    out = tmp_path_factory.mktemp("typed") / "deep" / "out"
    words = ("--duration", "3", "--seed", "2", "--equip", "0.1", "--format", "both", "--compare-paper")
    return out, typed("run", "highway", "--out", out, *words)


def test_run_writes_tables_and_a_summary_that_fits_the_terminal(
    both_formats: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, done = both_formats
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    for name in TABLES:
        csv, parquet = pd.read_csv(out / f"{name}.csv"), pd.read_parquet(out / f"{name}.parquet")
        assert list(csv.columns) == list(parquet.columns)
        assert len(csv) == len(parquet)
    assert (pd.read_csv(out / "steps.csv")["run_id"] == "highway-2").all()
    assert pd.read_csv(out / "steps.csv")["paper_recognised"].notna().any()
    lines = done.stdout.splitlines()
    assert lines[-1] == f"Tables: {out}"
    assert max(map(len, lines[:-1])) <= 80
    for word in (
        "equipped vehicles",
        "by SUMO class",
        "departures",
        "false per 100 km",
        "lane recognised",
        "published search",
    ):
        assert word in done.stdout


def test_texts_stand_without_quotation_marks(
    both_formats: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    out, _ = both_formats
    assert not any('"' in file.read_text() for file in out.glob("*.csv"))


def test_a_run_repeated_from_its_settings_writes_the_same_bytes(
    both_formats: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    out, _ = both_formats
    for settings in (out, tmp_path / "again"):  # and the repetition can be repeated
        done = typed("run", settings / "configuration.json", "--out", tmp_path / "again")
        assert done.returncode == 0, done.stderr
        for name in TABLES:
            assert (tmp_path / "again" / f"{name}.csv").read_bytes() == (out / f"{name}.csv").read_bytes()


def test_paper_mode_in_parquet_replaces_the_tables_that_were_there(tmp_path: Path) -> None:
    (tmp_path / "steps.csv").write_text("of an earlier run\n")
    done = typed("run", "straight", "--duration", "1", "--equip", "0.05", "--mode", "paper",
                 "--format", "parquet", "--out", tmp_path)  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = {file.name for file in tmp_path.iterdir()}
    assert written == {f"{name}.parquet" for name in TABLES} | {"configuration.json"}
    assert read_table(tmp_path, "runs")["mode"].tolist() == ["paper"]


def test_ctrl_c_keeps_the_rows_so_far(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*COMMAND, "run", "--duration", "3600", "--equip", "0.05", "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    steps = tmp_path / "steps.csv"
    patience = time.monotonic() + 100.0
    while not steps.exists() or steps.read_bytes().count(b"\n") < 2:  # first rows come after 10 s of traffic
        assert time.monotonic() < patience
        assert process.poll() is None
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said == f"interrupted: the rows so far are in {tmp_path}\n"
    text = steps.read_text()
    assert text.endswith("\n")
    assert {line.count(",") for line in text.splitlines()} == {len(TABLES["steps"]) - 1}
    rows, run = pd.read_csv(steps), pd.read_csv(tmp_path / "runs.csv").iloc[0]
    assert len(rows) == run["vehicle_steps"] > 0
    assert rows["time_s"].max() == run["end_s"] > run["begin_s"] + 9.0
    assert not rows.duplicated(["vehicle_id", "time_s"]).any()


def test_a_terminal_without_unicode_gets_question_marks_not_an_error(tmp_path: Path) -> None:
    words = ("run", "straight", "--duration", "0.3", "--equip", "0.1", "--out", tmp_path / "ü")
    done = subprocess.run(
        [*COMMAND, *map(str, words)],
        capture_output=True,
        timeout=120,
        check=False,
        env=os.environ | {"PYTHONIOENCODING": "ascii"},
    )
    assert done.returncode == 0, done.stderr
    assert b"? / ?" in done.stdout  # dashes: nothing was predicted in so short a time
    assert done.stdout.endswith(b"?\n")


def test_scenarios_are_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert status("scenarios") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("highway ")
    assert all(len(line.split(maxsplit=1)) == 2 for line in lines)


def test_the_versions_that_results_depend_on_are_a_line_each(capsys: pytest.CaptureFixture[str]) -> None:
    assert status("--version") == 0
    said = dict(line.split(" ", 1) for line in capsys.readouterr().out.splitlines())
    assert list(said) == ["python", "sumo-adas", "libsumo", "numpy", "numba", "opencv-python-headless"]
    assert said["numpy"] == np.__version__


@pytest.mark.parametrize("words", [[], ["--help"], ["--version"], ["run", "--help"], ["detect", "--help"]])
def test_help_is_on_standard_output(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert status(*words) == 0
    said = capsys.readouterr()
    assert said.out
    assert not said.err
    assert max(map(len, said.out.splitlines())) <= 80


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["runn"], "'runn'"),
        (["run", "highwy"], "did you mean 'highway'?"),
        (["run", "none.toml"], "none.toml: no such file"),
        (["run", "none.sumocfg"], "none.sumocfg: no such file"),
        (["run", "unknown_table.toml"], "unknown key 'equipmnt': did you mean 'equipment'?"),
        (["run", "unknown_key.toml"], "unknown key 'equipment.fracton': did you mean 'fraction'?"),
        (["run", "out_of_range.toml"], "duration_s = -1: input should be greater than 0"),
        (["run", "malformed.toml"], "malformed.toml: is not valid TOML"),
        (["run", "binary.toml"], "binary.toml: is not valid TOML"),
        (["run", "folder.toml"], "folder.toml: cannot be read"),
        (["run", "preset.toml"], "condition.preset = 'smog': known are clear"),
        (["run", "no_network.sumocfg"], "no such file"),
        (["run", "empty.sumocfg"], "names no network"),
        (["run", "cut_short.sumocfg"], "SUMO cannot read it"),
        (["run", "lane_less.sumocfg"], "the network has no lanes"),
        (["run", "lane_less.net.xml"], "the network has no lanes"),
        (["run", "--equip", "1.5"], "'--equip'"),
        (["run", "--duration", "0"], "'--duration'"),
        (["run", "--duration", "nan"], "'--duration'"),
        (["run", "--duration", "long"], "'--duration'"),
        (["run", "--seed", "-3"], "'--seed'"),
        (["run", "--mode", "papr"], "'papr' is not one of 'paper', 'refined'"),
        (["run", "--format", "json"], "'json' is not one of 'csv', 'parquet', 'both'"),
        (["run", "--duratio", "3"], "--duratio"),
        (["run", "--out", "text.png"], "'--out'"),
        (["run", "--duration", "1", "--out", "text.png/out"], "text.png"),
        (["detect", "road.png"], "--camera"),
        (["detect", "road.png", "--camera", "none.toml"], "none.toml: no such file"),
        (["detect", "road.png", "--camera", "unknown_key.toml"], "unknown key"),
        (["detect", "road.png", "--camera", "far.toml"], "height_m = 90"),
        (["detect", "none.mp4", "--camera", "camera.toml"], "none.mp4: no such file"),
        (["detect", "text.png", "--camera", "camera.toml"], "text.png"),
        (["detect", "text.mp4", "--camera", "camera.toml"], "text.mp4"),
        (["detect", "folder.toml", "--camera", "camera.toml"], "holds no image"),
        (["detect", "road.png", "--camera", "camera.toml", "--mode", "best"], "'--mode'"),
        (["calibrate"], "IMAGE"),
        (["calibrate", "none.png"], "none.png: no such file"),
        (["calibrate", "text.png"], "text.png"),
        (["calibrate", "grey.png"], "grey.png"),
        (["calibrate", "road.png", "--height", "-1"], "height_m"),
        (["calibrate", "road.png", "--field-of-view", "180"], "'--field-of-view'"),
        (["track", "none.csv"], "none.csv: no such file"),
        (["track", "no_time.csv"], "no_time.csv:1: column time_s is missing"),
        (["track", "radar.csv", "--filter", "kalman"], "filter = 'kalman': allowed are imm"),
        (["evaluate", "--scenario", "hihgway", "--seeds", "1"], "did you mean 'highway'?"),
        (["evaluate", "--equip", "7"], "'--equip'"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_what_is_wrong_is_said_in_one_line_and_nothing_is_written(
    words: list[str], expected: str, mistakes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(mistakes.rglob("*"))
    assert status(*words) == 2
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = [one for one in said.err.splitlines() if not one.startswith("compiling, once")]
    assert line.startswith("error: ")
    assert expected in line
    assert sorted(mistakes.rglob("*")) == before


def test_every_mistake_in_a_file_is_a_line(mistakes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (mistakes / "two.toml").write_text("duration_s = -1\nseed = 'x'\n")
    assert status("run", "two.toml") == 2
    lines = capsys.readouterr().err.splitlines()
    assert [line.removeprefix("error: ").split(" = ")[0] for line in lines] == [
        "two.toml: duration_s",
        "two.toml: seed",
    ]


@pytest.mark.parametrize("name", ["imm", "adaptive"])
def test_track_follows_the_object_of_a_log(
    name: str, mistakes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status("track", "radar.csv", "--filter", name, "--out", "tracked") == 0
    assert capsys.readouterr().out.splitlines() == [f"{'tracks':21} 1", "Tables: tracked"]
    last = pd.read_csv(mistakes / "tracked" / "tracks.csv").iloc[-1]
    assert last["range_m"] == pytest.approx(85.5, abs=0.5)
    assert last["range_rate_mps"] == pytest.approx(-5.0, abs=0.3)


def test_a_log_without_tracks_says_so(mistakes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("short.csv").write_text("".join(RADAR.splitlines(keepends=True)[:3]))
    assert status("track", "short.csv", "--out", "tracked") == 0
    assert "no object" in capsys.readouterr().out


def test_what_others_have_written_is_not_overwritten(
    mistakes: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, file in (("campaign", "plan.json"), ("run", "configuration.json")):
        Path(name).mkdir()
        Path(name, file).write_text("{}")
    commands = {"run": ["run", "straight"], "track": ["track", "radar.csv"]}
    commands["detect"] = ["detect", "road.png", "--camera", "camera.toml"]
    refused = [("run", "campaign"), ("track", "campaign"), ("track", "run"), ("detect", "run")]
    for command, directory in refused:
        assert status(*commands[command], "--out", directory) == 2
        said = capsys.readouterr().err
        assert said.startswith(f"error: {directory}: holds a {directory}'s tables: name another --out")
        assert len(list(Path(directory).iterdir())) == 1


def test_an_error_of_the_system_names_its_file(mistakes: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status("run", "straight", "--duration", "1", "--out", "/proc/nowhere") == 2
    assert capsys.readouterr().err == "error: /proc/nowhere: No such file or directory\n"


def test_who_reads_no_further_ends_the_command_quietly() -> None:
    words = " ".join([*COMMAND[:2], f"'{COMMAND[2]}'", "scenarios"])
    done = subprocess.run(["bash", "-c", f"{words} | true"], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_compiling_is_announced_once_and_only_where_it_is_done(capsys: pytest.CaptureFixture[str]) -> None:
    one_more, two_more = numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)
    with told_of_compiling():
        assert one_more(1) + two_more(1) == 5
    assert capsys.readouterr().err == "compiling, once, up to a minute\n"
    with told_of_compiling():
        assert one_more(1) == 2
    assert capsys.readouterr().err == ""


def test_the_commands_offer_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert status("track", "--help") == 0
    assert ", ".join(FILTERS) in " ".join(capsys.readouterr().out.split())
    assert [name.value for name in LogFormat] == ["csv", *FORMATS]


@pytest.mark.skipif(not BOLOGNA.is_dir(), reason="the published city scenario is not here")
def test_a_city_runs_and_writes_nothing_beside_its_files(tmp_path: Path) -> None:
    before = sorted(BOLOGNA.rglob("*"))
    done = typed("run", BOLOGNA / "run.sumocfg", "--duration", "30", "--equip", "0.2", "--out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(BOLOGNA.rglob("*")) == before
    steps = read_table(tmp_path, "steps")
    assert steps["vehicle_id"].nunique() >= 10
    in_junction = steps["lane_id"].str.startswith(":")
    assert in_junction.any()
    assert steps.loc[in_junction, "on_marked_road"].mean() < 0.25
    # below its minimum speed the assistance is silent
    assert not steps.loc[steps["speed_mps"] < 8.0, "ldw_active"].any()
    numbers = steps.select_dtypes("number")
    assert not np.isinf(numbers).any(axis=None)


def status(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(words)
    return int(left.value.code or 0)


@pytest.fixture
def mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current directory, with files that have errors."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(os.environ, "COLUMNS", "60")
    boundaries = 'convBoundary="0,0,1,1" origBoundary="0,0,1,1" projParameter="!"'
    net = f'<net version="1.20"><location netOffset="0,0" {boundaries}/></net>'
    files = {
        "unknown_table.toml": "[equipmnt]\nfraction = 0.2\n",
        "unknown_key.toml": "[equipment]\nfracton = 0.2\n",
        "out_of_range.toml": "duration_s = -1\n",
        "malformed.toml": "duration_s = = 2\n",
        "preset.toml": "condition = 'smog'\n",
        "camera.toml": CAMERA,
        "far.toml": "height_m = 90\n",
        "no_network.sumocfg": '<configuration><input><net-file value="no.net.xml"/></input></configuration>',
        "empty.sumocfg": "<configuration></configuration>",
        "cut_short.sumocfg": "<configuration><input>",
        "lane_less.net.xml": net,
        "lane_less.sumocfg": (
            '<configuration><input><net-file value="lane_less.net.xml"/></input></configuration>'
        ),
        "text.png": "not an image",
        "no_time.csv": "range_m\n3.0\n",
        "radar.csv": RADAR,
        "text.mp4": "not a video",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "folder.toml").mkdir()
    cv2.imwrite(str(tmp_path / "grey.png"), np.full((240, 320), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "road.png"), np.full((240, 320), 90, np.uint8))
    return tmp_path
