"""The report page: its contents, its notes on incomplete tables, and hostile texts."""

import html.parser
import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from analysis.cli import main
from analysis.metrics import prediction_errors
from analysis.report import ReportError, write_report
from analysis.report.page import render, safe_json
from analysis.report.reading import kind_of, read_run
from analysis.report.run_page import run_page
from analysis.report.scene import scene
from analysis.report.viewer import viewer_data
from analysis.statistics import clustered_share
from plugin.record import Recorder
from plugin.schema import TABLES
from tests.analysis.report_tables import (
    HOSTILE,
    STEPS,
    made_drive,
    write_campaign,
    write_recording,
    write_run,
)


class Elements(html.parser.HTMLParser):
    """Tags with their attributes, and the texts of scripts by id, as a browser would see them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: dict[str, str] = {}
        self._open = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self._open = str(dict(attrs).get("id") or "") if tag == "script" else ""

    def handle_data(self, data: str) -> None:
        if self._open:
            self.scripts[self._open] = self.scripts.get(self._open, "") + data

    def handle_endtag(self, tag: str) -> None:
        self._open = ""


@pytest.fixture(autouse=True)
def _pictures_in_no_time(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make figures without drawing them, which takes most of the time; other tests draw them."""
    if request.node.name != "test_run_page_shows_its_figures":
        monkeypatch.setattr(
            "analysis.report.cards.save", lambda figure, target, kind: target.write(b"<svg/>")
        )


def page_of(directory: Path) -> str:
    return write_report(directory, frames=False).read_text(encoding="utf-8")


def test_run_page_shows_its_figures(tmp_path: Path) -> None:
    text = page_of(write_run(tmp_path))
    for words in ("made-1", "333.33 (3)", "Prediction error by horizon", "Motion classes", "What is missing"):
        assert words in text
    assert text.count("data:image/svg+xml;base64,") == 7
    drawn = json.loads(Elements(text).scripts["scene"])
    assert [vehicle["id"] for vehicle in drawn["vehicles"]] == ["one", "three", "two"]
    assert [len(events["x"]) for events in drawn["events"]] == [3, 3, 3]
    first = drawn["vehicles"][0]
    assert first["episodes"] == [["distraction", 12.6, 14.1]]
    assert len(first["columns"]["offset"]) == STEPS


def test_hostile_texts_become_no_markup(tmp_path: Path) -> None:
    run = run_page(write_run(tmp_path, HOSTILE), frames=False)
    run.title = run.notes[0] = HOSTILE[0]
    run.drives = [viewer_data(made_drive(name, steps=3)) for name in HOSTILE]
    plain = run_page(write_run(tmp_path / "plain", ("a", "b", "c")), frames=False)
    plain.drives = [viewer_data(made_drive(name, steps=3)) for name in ("a", "b", "c")]
    hostile, tame = (Elements(render(page)) for page in (run, plain))
    assert [tag for tag, _ in hostile.tags] == [tag for tag, _ in tame.tags]
    assert not [
        attributes for _, attributes in hostile.tags if any(name.startswith("on") for name in attributes)
    ]
    ids = {vehicle["id"] for vehicle in json.loads(hostile.scripts["scene"])["vehicles"]}
    assert ids == set(HOSTILE)  # and each is still what it was


@pytest.mark.parametrize("text", [*HOSTILE, "</ScRiPt>", "]]>", "\u2029", "\\u003c"])
def test_json_in_a_script_is_harmless_and_exact(text: str) -> None:
    written = str(safe_json({"id": text, "none": float("nan")}))
    assert not set(written) & set("<>&'\u2028\u2029")
    assert json.loads(written) == {"id": text, "none": None}


def test_policy_lets_only_the_pages_own_scripts_run(tmp_path: Path) -> None:
    text = page_of(write_run(tmp_path))
    policy = next(a["content"] for _, a in Elements(text).tags if a.get("http-equiv"))
    assert policy is not None
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy.split("script-src")[1].split(";")[0]
    assert "http://" not in text.split("</style>")[0]
    assert not [
        a
        for tag, a in Elements(text).tags
        if tag in ("script", "link", "iframe") and ("src" in a or "href" in a)
    ]


@pytest.mark.parametrize("table", TABLES)
def test_missing_table_is_said_and_the_rest_shown(tmp_path: Path, table: str) -> None:
    (write_run(tmp_path) / f"{table}.csv").unlink()
    run = read_run(tmp_path)
    assert any(f"no table {table}" in note for note in run.notes)
    assert list(run[table].columns) == [column.name for column in TABLES[table]]
    if table in ("steps", "predictions"):  # what most is drawn from
        assert f"no table {table}" in page_of(tmp_path)


@pytest.mark.parametrize("parity", [0, 1])
def test_older_schema_is_said_and_the_rest_shown(tmp_path: Path, parity: int) -> None:
    write_run(tmp_path)
    for name in TABLES:
        table = pd.read_csv(tmp_path / f"{name}.csv")
        keep = [c for i, c in enumerate(table) if i % 2 == parity or c in ("run_id", "vehicle_id", "time_s")]
        table[keep].to_csv(tmp_path / f"{name}.csv", index=False)
    text = page_of(tmp_path)
    assert "Table steps is of another version: it has no column" in text
    assert "Timeline of a vehicle" in text


def test_conflicts_of_which_no_warning_is_known_are_not_due(tmp_path: Path) -> None:
    path = write_run(tmp_path) / "conflicts.csv"
    pd.read_csv(path).drop(columns="warned").to_csv(path, index=False)
    text = page_of(tmp_path)
    assert "Table conflicts is of another version: it has no column warned" in text
    assert "none due" in text


def test_interrupted_run_keeps_what_is_whole(tmp_path: Path) -> None:
    write_run(tmp_path)
    steps = tmp_path / "steps.csv"
    steps.write_bytes(steps.read_bytes()[:-60])
    (tmp_path / "runs.csv").write_bytes(b"")
    (tmp_path / "tracks.csv").unlink()
    (tmp_path / "tracks.parquet.part").write_bytes(b"PAR1 and no end")
    (tmp_path / "conflicts.csv").write_text("run_id,vehicle_id\nmade-1,one,too,many\n")
    text = page_of(tmp_path)
    for note in (
        "steps.csv ends within a row",
        "tracks.parquet.part",
        "The run was interrupted",
        "too many fields",
    ):
        assert note in text
    assert len(read_run(tmp_path)["steps"]) == 3 * STEPS - 1


def test_killed_parquet_run_keeps_its_parts(tmp_path: Path) -> None:
    write_run(tmp_path / "whole", formats=("parquet",))
    steps = pd.read_parquet(tmp_path / "whole" / "steps.parquet")
    recorder = Recorder("made-1", tmp_path / "killed", ("parquet",))
    rows = steps.head(50).drop(columns="run_id").dropna(axis=1)
    recorder.append("steps", {name: rows[name].tolist() for name in rows})
    assert kind_of(tmp_path / "killed") == "run"  # and the recorder is never closed
    run = read_run(tmp_path / "killed")
    assert len(run["steps"]) == 50
    assert any("interrupted" in note for note in run.notes)
    assert "The run was interrupted" in page_of(tmp_path / "killed")


def test_damaged_files_are_said(tmp_path: Path) -> None:
    write_run(tmp_path, formats=("csv", "parquet"))
    whole = (tmp_path / "steps.parquet").read_bytes()
    (tmp_path / "steps.parquet").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "warnings.parquet").unlink()
    (tmp_path / "warnings.csv").write_bytes(bytes(range(256)) * 20)
    (tmp_path / "configuration.json").write_text("{")
    run = read_run(tmp_path)
    assert len(run["steps"]) == 3 * STEPS  # from the CSV beside it
    assert len(run["warnings"]) == 0
    assert any("steps.parquet cannot be read" in note for note in run.notes)
    assert any("warnings.csv" in note for note in run.notes)
    assert any("configuration.json" in note for note in run.notes)


def test_text_in_a_number_column_spoils_that_column_alone(tmp_path: Path) -> None:
    write_run(tmp_path)
    path = tmp_path / "departures.csv"
    path.write_text(path.read_text().replace("25", "fast"))
    run = read_run(tmp_path)
    assert run["departures"]["speed_mps"].isna().all()
    assert run["departures"]["crossing_s"].tolist() == [14.0] * 3


def test_nobody_equipped(tmp_path: Path) -> None:
    text = page_of(write_run(tmp_path, ()))
    assert "No equipped vehicle drove" in text
    assert "made; by hand" in text.replace(", ", "; ")


def test_campaign_and_recording_pages(tmp_path: Path) -> None:
    campaign = page_of(write_campaign(tmp_path / "campaign"))
    for words in (
        "4 of 5 runs are done",
        "Rates by cell",
        "departures warned",
        "Failed runs: 1",
        "condition",
    ):
        assert words in campaign
    assert "<img src=x" not in campaign
    recording = page_of(write_recording(tmp_path / "recording"))
    assert "Lane over time" in recording
    assert "Radar tracks over time" in recording
    (tmp_path / "campaign" / "shares.csv").unlink()
    assert "The report lacks shares.csv" in page_of(tmp_path / "campaign")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["report", "nowhere"], "nowhere: no such directory"),
        (["report", "."], "holds no table"),
        (["plot"], "plot needs DIR and NAME"),
        (["plot", ".", "timelin"], "did you mean 'timeline'?"),
        (["plot", ".", "rates"], "holds no rates.csv"),
        (["plot", ".", "map"], "holds no table"),
    ],
)
def test_errors_are_one_line(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_page_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    write_recording(tmp_path)
    (tmp_path / "taken").mkdir()
    with pytest.raises(ReportError, match="cannot be written"):
        write_report(tmp_path, tmp_path / "taken")


def test_kinds(tmp_path: Path) -> None:
    assert kind_of(write_run(tmp_path / "a")) == "run"
    assert kind_of(write_campaign(tmp_path / "b")) == "campaign"
    assert kind_of(write_recording(tmp_path / "c")) == "recording"


def test_pictures_are_thinned_out_to_fit() -> None:
    drive = made_drive(steps=40)
    whole = viewer_data(drive)
    assert whole["every"] == 1
    assert len(whole["steps"]) == 40
    size = len(json.dumps(whole["steps"], separators=(",", ":")))
    thin = viewer_data(drive, size // 3)
    assert thin["every"] in (3, 4)
    assert whole["steps"][0]["tracks"] == [[60.0, 0.0, whole["classes"].index("same_direction"), 1, 1, None]]
    assert [step["time"] for step in thin["steps"]] == [step["time"] for step in whole["steps"]][
        :: thin["every"]
    ]
    first = whole["steps"][0]
    assert first["path"][0][0] == pytest.approx(160.0, abs=1.0)  # straight ahead: in the middle
    assert first["borders"][0][0] == [-19.5, 239.5]  # y = 0: the bottom row
    assert first["road"][0][0] == 1
    assert whole["start"] == 12.0  # half a second before the first departure or warning


def test_vehicles_with_most_events_stay_when_rows_are_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = read_run(write_run(tmp_path))
    monkeypatch.setattr("analysis.report.scene.MOST_ROWS", 2 * STEPS)
    drawn = scene(run, [])
    assert drawn is not None
    assert len(drawn["vehicles"]) == 2
    assert len(drawn["paths"]) == 3
    assert any("2 of 3" in note for note in run.notes)


def test_share_with_interval_over_vehicles() -> None:
    rng = np.random.default_rng(1)
    rates = rng.beta(9, 1, 60)
    rows = pd.DataFrame(
        {
            "run_id": "r",
            "vehicle_id": np.repeat(np.arange(60), 50),
            "hit": rng.random(3000) < np.repeat(rates, 50),
        }
    )
    share, low, high = clustered_share(rows, "hit")
    assert share == pytest.approx(rows["hit"].mean())
    # normal interval of the mean of as many equally long clusters
    per_vehicle = rows.groupby("vehicle_id")["hit"].mean()
    half = 1.96 * per_vehicle.std() / np.sqrt(60)
    assert (high - low) / 2 == pytest.approx(half, rel=0.2)
    assert np.isnan(clustered_share(rows[rows["vehicle_id"] == 0], "hit")[1:]).all()
    assert np.isnan(clustered_share(rows.iloc[:0], "hit")[0])


def test_prediction_table_is_that_of_the_metrics(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path))
    table = prediction_errors(run["predictions"]).set_index("horizon_s")
    assert (
        f"{100 * table.loc[2.0, 'predicted_median_m']:.1f} / {100 * table.loc[2.0, 'predicted_p95_m']:.1f}"
        in page_of(tmp_path)
    )
