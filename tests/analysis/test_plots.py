"""Figures: show the right numbers, are never empty, and are byte-identical when repeated."""

import io
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from analysis import plots
from analysis.metrics import prediction_errors
from analysis.plots.campaign import cell_names, error_times
from analysis.plots.drive import busiest, episodes, with_gaps
from analysis.plots.style import save
from analysis.published import correction, imm
from analysis.published.adaptive import TOLD
from analysis.report.reading import ReportError, read_run
from tests.analysis.report_tables import HOSTILE, write_campaign, write_recording, write_run

ENDS = ("median", "p95")
ON_PAGES = {name for name, one in plots.PLOTS.items() if one.source != "published"} - {"map", "timeline"}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("made")
    published = folder / "published"
    published.mkdir()
    correction.curves().to_csv(published / "correction_curves.csv", index=False)
    imm.curves(imm.ImmExperiment(runs=2)).to_csv(published / "imm_curves.csv", index=False)
    pd.DataFrame(
        {
            "run": "r",
            "observer": "paper",
            "time_s": [0.0, 1.0],
            "true_yaw_rate_rps": [0, 1],
            "yaw_rate_rps": [0, 1],
        }
        | {"true_lateral_speed_mps": [0, 1], "lateral_speed_mps": [0, 1]}
    ).to_csv(published / "simulation_curves.csv", index=False)
    pd.DataFrame(
        {"run": "r", "chain": "paper", "car": 0, "time_s": [0.0, 1.0], "true_lateral_offset_m": [0, 1]}
        | {"lateral_offset_m": [0.1, 1]}
    ).to_csv(published / "road_steps.csv", index=False)
    pd.DataFrame(
        {
            "run": "r",
            "path": ["driven", "driven", "paper", "paper"],
            "forward_m": [0, 9, 0, 9],
            "left_m": [0, 1, 0, 2],
        }
    ).to_csv(published / "road_paths.csv", index=False)
    pd.DataFrame(
        {"scenario": "straight", "condition": "clear", "chain": ["paper", "refined"]}
        | {"recognised_percent": [60.0, 99.0], "published_percent": 100.0}
    ).to_csv(published / "recognition.csv", index=False)
    pd.DataFrame({"class": ["frame 1", "later frames"], "ms": [0.6, 0.2], "published_ms": [210, 30]}).to_csv(
        published / "search-times.csv", index=False
    )
    cases = [
        {"case": case, "filter": "adaptive", "time_s": t, "rmse_vx_mps": 1.0 - t / 2, "r_ratio_v": 1.0}
        for case in TOLD
        for t in (0.0, 1.0)
    ]
    pd.DataFrame(cases).to_csv(published / "adaptive_curves.csv", index=False)
    return {
        "run": write_run(folder / "run", ("one", HOSTILE[2])),
        "campaign": write_campaign(folder / "campaign"),
        "recording": write_recording(folder / "recording"),
        "published": published,
    }


@pytest.mark.parametrize("name", plots.PLOTS)
def test_every_figure_has_something_in_it(name: str, made: dict[str, Path], tmp_path: Path) -> None:
    figure = plots.draw(made[plots.PLOTS[name].source], name)
    assert all(axes.has_data() or not axes.axison for axes in figure.axes)
    assert any(axes.has_data() for axes in figure.axes)
    if name in ON_PAGES:  # test_report_browser looks at these
        return
    path = plots.write(figure, tmp_path / f"{name}.png")
    picture = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert picture is not None
    assert min(picture.shape) > 300
    assert 0.005 < float((picture < 200).mean()) < 0.6


def test_prediction_error_draws_the_metrics_numbers(made: dict[str, Path]) -> None:
    predictions = read_run(made["run"])["predictions"]
    expected = prediction_errors(predictions)
    median, tail = plots.prediction_error(predictions).axes
    assert median.lines[0].get_ydata() == pytest.approx(100 * expected["predicted_median_m"])
    assert tail.lines[2].get_ydata() == pytest.approx(100 * expected["constant_velocity_p95_m"])


def test_tlc_error_is_a_distribution(made: dict[str, Path]) -> None:
    axes = plots.tlc_error(read_run(made["run"])["steps"]).axes[0]
    error, share = axes.lines[0].get_data()
    assert error == pytest.approx(0.1)  # every estimate is 0.1 s late
    assert share[-1] == pytest.approx(100.0)


def test_offset_is_drawn_with_a_gap_where_the_lane_changes() -> None:
    rows = pd.DataFrame(
        {"time_s": [0.0, 0.1, 0.2, 0.3, 1.0], "true_lateral_offset_m": [1.6, 1.7, -1.9, -1.8, 0.0]}
    )
    drawn = with_gaps(rows, ["true_lateral_offset_m"])
    assert np.flatnonzero(drawn["true_lateral_offset_m"].isna()).tolist() == [2, 5]


def test_episodes_are_the_spells_of_a_cause() -> None:
    cause = ["lane_keeping", "distraction", "distraction", "lane_keeping", "microsleep", "microsleep"]
    rows = pd.DataFrame({"time_s": [0.0, 0.1, 0.2, 0.3, 0.4, 0.9], "true_cause": cause})
    found = [("distraction", 0.1, 0.2), ("microsleep", 0.4, 0.4), ("microsleep", 0.9, 0.9)]
    assert episodes(rows) == found


def test_cells_are_named_by_the_grid() -> None:
    table = pd.DataFrame(
        {"cell": ["all", 0, 1], "figure": "f", "a.light": [None, "clear", "night"], "low": [1, 2, 3]}
    )
    assert cell_names(table).tolist() == ["all", "a light clear", "a light night"]


@pytest.mark.parametrize(("counted", "words"), [(0, ["no times were counted"]), (2, [])])
def test_errors_of_times_that_were_not_counted_are_left_out(counted: int, words: list[str]) -> None:
    """Fewer than three kinds of times, as of a campaign in which no border was crossed."""
    names = ("ttc_error", "tlc_true_state_error", "tlc_error")
    row = {f"{name}_{end}_s": 0.2 if k < counted else np.nan for k, name in enumerate(names) for end in ENDS}
    axes = error_times(pd.DataFrame([row])).axes[0]
    assert [text.get_text() for text in axes.texts] == words
    assert axes.get_legend_handles_labels()[1] == (["median", "95th percentile"] if counted else [])


def test_timeline_of_an_unknown_vehicle_is_an_error(made: dict[str, Path]) -> None:
    run = read_run(made["run"])
    assert busiest(run["steps"], run["departures"], run["warnings"]) == min("one", HOSTILE[2])
    with pytest.raises(ValueError, match="no equipped vehicle"):
        plots.draw(made["run"], "timeline", "nobody")


def test_same_figure_same_bytes(made: dict[str, Path]) -> None:
    def drawn(kind: str) -> bytes:
        out = io.BytesIO()
        save(plots.draw(made["run"], "warnings"), out, kind)
        return out.getvalue()

    for kind in ("png", "svg"):
        assert drawn(kind) == drawn(kind)


def test_other_suffixes_are_refused(made: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(ReportError, match=r"must be one of \.png, \.svg, \.pdf"):
        plots.write(plots.draw(made["run"], "warnings"), tmp_path / "figure.gif")
