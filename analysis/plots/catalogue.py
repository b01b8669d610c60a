"""All figures of `sumo-adas plot DIR NAME` by name, and the files that they are drawn from."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from analysis.plots import campaign, drive, published, recording, run
from analysis.plots.style import save
from analysis.report.outline import outline
from analysis.report.reading import ReportError, RunTables, kind_of, read_csv, read_run

FORMATS = ("png", "svg", "pdf")


class Plot(NamedTuple):
    """A figure that can be requested by name."""

    source: str  # run, campaign, recording, published
    title: str
    draw: Callable[[Path, str | None], Figure]  # the directory, and a vehicle's id


def _of_run(draw: Callable[[RunTables], Figure]) -> Callable[[Path, str | None], Figure]:
    return lambda directory, vehicle: draw(_run(directory))


def _of_csv(draw: Callable[[pd.DataFrame], Figure], name: str) -> Callable[[Path, str | None], Figure]:
    return lambda directory, vehicle: draw(_csv(directory, name))


def _published(experiment: str) -> Callable[[Path, str | None], Figure]:
    """From the files of `sumo-adas reproduce` in the directory, else by running the experiment."""

    def drawn(directory: Path, vehicle: str | None) -> Figure:
        files, draw = published.FIGURES[experiment]
        for folder in (directory, directory / experiment):
            if all((folder / file).is_file() for file in files):
                return draw(*(pd.read_csv(folder / file) for file in files))
        from analysis.published.experiments import reproduce

        with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work:
            reproduce(experiment, Path(work))
            return draw(*(pd.read_csv(Path(work) / file) for file in files))

    return drawn


def _times(name: str) -> Callable[[Path, str | None], Figure]:
    return lambda directory, vehicle: campaign.times(_csv(directory, "times.csv"), name)


def _roc(directory: Path, vehicle: str | None) -> Figure:
    notes: list[str] = []
    tables = {kind: read_csv(directory, f"sweep_{kind}.csv", notes) for kind in ("ldw", "fcw")}
    if all(table.empty for table in tables.values()):
        raise ReportError(
            f"{directory}: holds no sweep_ldw.csv or sweep_fcw.csv: run `sumo-adas sweep {directory}`"
        )
    return campaign.roc(tables)


def _map(directory: Path, vehicle: str | None) -> Figure:
    tables = _run(directory)
    return drive.road_map(tables["steps"], tables["departures"], tables["warnings"], outline(tables))


def _timeline(directory: Path, vehicle: str | None) -> Figure:
    tables = _run(directory)
    return drive.timeline(tables["steps"], tables["departures"], tables["warnings"], vehicle)


PLOTS: dict[str, Plot] = {
    "map": Plot("run", "driven paths, departures, warnings on the road", _map),
    "timeline": Plot(
        "run", "one vehicle over time: offset, borders, TLC, TTC, warnings (--vehicle)", _timeline
    ),
    "prediction": Plot(
        "run",
        "prediction error by horizon against baselines",
        _of_run(lambda t: run.prediction_error(t["predictions"])),
    ),
    "situations": Plot(
        "run",
        "prediction error by driver action and road curvature",
        _of_run(lambda t: run.prediction_by_category(t["predictions"], t["steps"])),
    ),
    "recognition": Plot(
        "run", "share of frames with the lane found", _of_run(lambda t: run.recognition(t["steps"]))
    ),
    "tlc": Plot("run", "error of the time to lane crossing", _of_run(lambda t: run.tlc_error(t["steps"]))),
    "ttc": Plot(
        "run", "time to collision, estimated over true", _of_run(lambda t: run.ttc_error(t["steps"]))
    ),
    "warnings": Plot("run", "warnings by outcome", _of_run(lambda t: run.warning_outcomes(t["warnings"]))),
    "classes": Plot(
        "run", "motion classes of radar tracks", _of_run(lambda t: run.motion_classes(t["tracks"]))
    ),
    "rates": Plot("campaign", "events per 100 km by cell", _of_csv(campaign.rates, "rates.csv")),
    "shares": Plot(
        "campaign", "warned and recognised shares by cell", _of_csv(campaign.shares, "shares.csv")
    ),
    "tlc-distribution": Plot("campaign", "true times to lane crossing by cell", _times("true_tlc")),
    "ttc-distribution": Plot("campaign", "true times to collision by cell", _times("true_ttc")),
    "lead-times": Plot("campaign", "lead of lane-departure warnings by cell", _times("ldw_lead_time")),
    "roc": Plot("campaign", "hits against unwanted warnings over the threshold (after sweep)", _roc),
    "benefit": Plot("campaign", "events that drivers avoid", _of_csv(campaign.benefit, "benefit.csv")),
    "predictions": Plot(
        "campaign", "prediction error by horizon", _of_csv(campaign.prediction, "predictions.csv")
    ),
    "lanes": Plot("recording", "the lane found in footage over time", _of_csv(recording.lanes, "lanes.csv")),
    "tracks": Plot("recording", "radar tracks over time", _of_csv(recording.tracks, "tracks.csv")),
    "observer": Plot(
        "published",
        "Z11 figures 14-16: yaw rate and lateral speed, simulated and observed",
        _published("simulation"),
    ),
    "road": Plot(
        "published",
        "Z11 figures 17-19: borders, true, observed and predicted path",
        _published("road"),
    ),
    "published-recognition": Plot(
        "published",
        "Z11 conclusion 1: frames with the lane found, published and default chain",
        _published("recognition"),
    ),
    "search-times": Plot(
        "published", "Z11 table 4: time of the genetic search per frame", _published("search-times")
    ),
    "correction": Plot(
        "published",
        "Z11 figure 13: correction factor of the steer over speed",
        _published("correction"),
    ),
    "imm": Plot(
        "published",
        "IMM source: RMSE over time of CV, CA and IMM",
        _published("imm"),
    ),
    "adaptive": Plot(
        "published",
        "CN104635233A: the adaptive filter as published and in its safe form",
        _published("adaptive"),
    ),
}


def draw(directory: Path, name: str, vehicle: str | None = None) -> Figure:
    """The figure `name` from the files in `directory`; published ones are computed if it has none.

    Raises ReportError for an unknown name, or a directory without the files needed, ValueError for an
    unknown vehicle.
    """
    if name not in PLOTS:
        import difflib

        near = difflib.get_close_matches(name, PLOTS, n=1)
        hint = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(PLOTS)}"
        raise ReportError(f"no figure '{name}': {hint}")
    return PLOTS[name].draw(Path(directory), vehicle)


def write(figure: Figure, out: Path) -> Path:
    """Write a figure in the format of the suffix. Raises ReportError for an unknown one, or if it fails."""
    suffix = out.suffix.lower().removeprefix(".")
    if suffix not in FORMATS:
        raise ReportError(
            f"--out {out}: its suffix must be one of {', '.join('.' + name for name in FORMATS)}"
        )
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        save(figure, out, suffix)
    except OSError as error:
        raise ReportError(f"{out}: cannot be written ({error.strerror or error})") from None
    return out


def _run(directory: Path) -> RunTables:
    kind = kind_of(directory)
    if kind != "run":
        raise ReportError(f"{directory}: holds a {kind}, but the figure needs the tables of a run")
    return read_run(directory)


def _csv(directory: Path, name: str) -> pd.DataFrame:
    if not directory.is_dir():
        raise ReportError(f"{directory}: no such directory")
    if not (directory / name).is_file():
        raise ReportError(f"{directory}: holds no {name}, which the figure is drawn from")
    return read_csv(directory, name, [])
