"""The page of a run."""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from analysis import metrics
from analysis.drive import DriveError, load_drive, most_interesting, vehicles_with_frames
from analysis.plots import run as figures
from analysis.report.cards import Card, Grid, Page, card, grid_of
from analysis.report.outline import outline
from analysis.report.reading import RunTables, read_run
from analysis.report.scene import scene
from analysis.report.viewer import DRIVES_BYTES, viewer_data
from analysis.statistics import clustered_share, per_100_km, poisson_interval, wilson_interval
from plugin.truth import HORIZONS_S
from sumo_net.settings import SettingsError
from sumo_net.step import STEP_S
from sumo_net.traffic import TrafficError

MOST_EVENTS = 200  # rows of a table of events
MOST_DRIVES = 4


def run_page(
    directory: Path,
    vehicles: Sequence[str] = (),
    frames: bool = True,
    tell: Callable[[str], None] = lambda text: None,
) -> Page:
    """The page of the run whose tables lie in `directory`.

    vehicles : those whose drives the viewer shows; by default those whose frames were kept, else the most
        interesting one. If frames are missing, the run is repeated for them (`analysis.replay`).
    frames : False leaves the viewer out.

    Raises DriveError for a vehicle in `vehicles` that the run does not have.
    """
    run = read_run(directory)
    page = Page(_title(run), _subtitle(run))
    page.facts = _facts(run)
    if not run["steps"].empty:
        page.figures = _figures(run)
        page.scene = scene(run, outline(run))
    if frames:
        page.drives = _drives(run, vehicles, tell)
    page.cards = _cards(run)
    page.events = _events(run)
    if run.settings:
        page.settings = json.dumps(run.settings, indent=1, ensure_ascii=False)
    page.notes = run.notes
    return page


def _title(run: RunTables) -> str:
    title = str(run.settings.get("title") or "")
    runs = run["runs"]
    name = str(runs["run_id"].iloc[0]) if len(runs) else ""
    if not name and len(run["steps"]):
        name = str(run["steps"]["run_id"].iloc[0])
    return f"{name}: {title}" if name and title else name or title or str(run.directory)


def _subtitle(run: RunTables) -> str:
    return str(run.settings.get("purpose") or "Lane-departure and rear-end warning in a SUMO run")


def _facts(run: RunTables) -> list[tuple[str, str]]:
    facts: list[tuple[str, str]] = []
    steps = run["steps"]
    row: Any = run["runs"].iloc[0].to_dict() if len(run["runs"]) else {}
    if len(steps):
        begin, end = float(steps["time_s"].min()), float(steps["time_s"].max())
        facts += [
            ("Simulated", f"{end - begin + STEP_S:.0f} s"),
            ("Equipped vehicles", str(steps["vehicle_id"].nunique())),
            ("Driven by them", f"{metrics.distance_km(steps):.1f} km"),
        ]
    for name, label in (("seed", "Seed"), ("mode", "Mode")):
        if row.get(name) is not None and row[name] == row[name]:
            facts.append((label, str(row[name])))
    if row.get("versions"):
        facts.append(("Versions", str(row["versions"]).replace("; ", ", ")))
    if row.get("configuration_hash"):
        facts.append(("Settings' hash", str(row["configuration_hash"])[:12]))
    return facts


def _figures(run: RunTables) -> list[Grid]:
    steps = run["steps"]
    counts = metrics.summary(
        steps, run["predictions"], run["warnings"], run["departures"], run["tracks"], run["conflicts"]
    )
    marked = steps[steps["on_marked_road"].fillna(False)]
    km = counts["distance_km"]
    lane = [
        ("departures per 100 km", *_rate(counts["departures"], km)),
        ("departures warned before", *_share(counts["departures_warned"], counts["departures_due"])),
        ("median lead time", _number(counts["median_lead_time_s"], "s"), ""),
        ("false warnings per 100 km", *_rate(counts["warnings_false"], km)),
        ("nuisance warnings per 100 km", *_rate(counts["warnings_nuisance"], km)),
        ("lane recognised", *_clustered(marked, "recognised")),
        ("lateral offset, RMS error", _number(100 * counts["lateral_offset_rmse_m"], "cm", 1), ""),
        ("heading, RMS error", _number(1e3 * counts["heading_rmse_rad"], "mrad"), ""),
        ("TLC below 1 s, median error", _number(counts["tlc_error_median_s"], "s", 3), ""),
    ]
    if not math.isnan(counts["paper_recognition_rate"]):
        lane.insert(6, ("… by the published search", *_clustered(marked, "paper_recognised")))
    rear = [
        ("conflicts per 100 km", *_rate(counts["conflicts"], km)),
        ("conflicts warned in time", *_share(counts["conflicts_due_warned"], counts["conflicts_due"])),
        ("false danger warnings per 100 km", *_rate(counts["fcw_danger_false"], km)),
        ("nuisance danger warnings per 100 km", *_rate(counts["fcw_danger_nuisance"], km)),
        ("false reminders per 100 km", *_rate(counts["fcw_reminder_false"], km)),
        ("TTC below 3 s, median error", _number(counts["ttc_error_median_s"], "s", 3), ""),
        ("motion class right", _percent(counts["class_accuracy"]), ""),
    ]
    header = ("figure", "value", "95 % interval")
    text = "Rates with exact Poisson intervals, shares with Wilson's; for frames a bootstrap over vehicles."
    return [
        Grid("Lane departure", header, lane, text),
        Grid(
            "Rear end",
            header,
            rear,
            "A warning is due if the leader has been in path and in view for 1 s.",
        ),
        _prediction_grid(counts),
    ]


def _prediction_grid(counts: dict[str, float]) -> Grid:
    rows = []
    for name, label in figures.PREDICTORS.items():
        cells = [
            f"{_number(100 * counts[f'{name}_error_{h:.1f}s_median_m'], '', 1)} / "
            f"{_number(100 * counts[f'{name}_error_{h:.1f}s_p95_m'], '', 1)}"
            for h in HORIZONS_S
        ]
        rows.append((label, *cells))
    header = ("lateral error in cm", *(f"{h:.1f} s ahead" for h in HORIZONS_S))
    return Grid("Prediction", header, rows, "Median / 95th percentile.")


def _drives(run: RunTables, vehicles: Sequence[str], tell: Callable[[str], None]) -> list[dict[str, Any]]:
    if run["steps"].empty:
        return []
    kept = vehicles_with_frames(run.directory)
    names = list(vehicles)
    found = []
    try:
        if not names:
            have = set(run["steps"]["vehicle_id"].astype(str))
            names = [name for name in kept if name in have][:MOST_DRIVES]
            names = names or [most_interesting(run.directory)]
        missing = [name for name in names if name not in kept]
        if missing:
            from analysis.replay import replay, settings_to_repeat

            settings_to_repeat(run.directory)  # raises before anything is announced
            tell(f"repeating the run for the camera frames of {', '.join(missing)} (--no-frames: without)")
            run.notes.extend(replay(run.directory, missing))
        for name in names:
            found.append(viewer_data(load_drive(run.directory, name), DRIVES_BYTES // len(names)))
    except (DriveError, SettingsError, TrafficError, OSError, KeyError, ValueError) as error:
        if vehicles and isinstance(error, DriveError):
            raise
        run.notes.append(f"The drive viewer is left out: {error}")
    return found


def _cards(run: RunTables) -> list[Card]:
    steps, predictions = run["steps"], run["predictions"]
    if steps.empty and predictions.empty and run["warnings"].empty and run["tracks"].empty:
        return []
    return [
        card(
            "Prediction error by horizon",
            "Lateral distance between the predicted and the driven path, against both baselines and against "
            "the same predictor fed with the true state.",
            lambda: figures.prediction_error(predictions),
        ),
        card(
            "Prediction error by situation",
            "Median one and two seconds ahead, by driver action and road curvature.",
            lambda: figures.prediction_by_category(predictions, steps),
        ),
        card(
            "Lane recognition",
            "Share of frames in which both borders were found, by situation; lines are 95 % bootstrap "
            "intervals over vehicles.",
            lambda: figures.recognition(steps),
        ),
        card(
            "Error of the time to lane crossing",
            "Where the true time is under 1 s: the higher and further left a curve, the better.",
            lambda: figures.tlc_error(steps),
        ),
        card(
            "Time to collision",
            "Estimated by the radar chain against the true one, where the leader is in view.",
            lambda: figures.ttc_error(steps),
        ),
        card(
            "Warnings by outcome",
            "True: the event followed. Nuisance: the driver corrected. False: no such drift or approach.",
            lambda: figures.warning_outcomes(run["warnings"]),
        ),
        card(
            "Motion classes of radar tracks",
            "Estimated by true class, after the third cycle.",
            lambda: figures.motion_classes(run["tracks"]),
        ),
    ]


def _events(run: RunTables) -> list[Grid]:
    departures = run["departures"].sort_values("crossing_s", kind="stable")
    warnings = run["warnings"].sort_values("start_s", kind="stable")
    conflicts = run["conflicts"].sort_values("start_s", kind="stable")
    meant = metrics.unsignalled(departures)
    return [
        grid_of(
            meant,
            f"Departures without a turn signal ({len(meant)})",
            ("vehicle_id", "side", "crossing_s", "cause", "speed_mps", "warned", "lead_time_s", "in_zone"),
            MOST_EVENTS,
            "Empty under warned: no warning was due, as the vehicle was slow.",
        ),
        grid_of(
            warnings,
            f"Warnings ({len(warnings)})",
            (
                "vehicle_id",
                "kind",
                "level",
                "side",
                "start_s",
                "end_s",
                "tlc_s",
                "ttc_s",
                "lead_time_s",
                "outcome",
            ),
            MOST_EVENTS,
        ),
        grid_of(
            conflicts,
            f"Rear-end conflicts ({len(conflicts)})",
            (
                "vehicle_id",
                "target_id",
                "start_s",
                "end_s",
                "min_ttc_s",
                "min_gap_m",
                "warned",
                "lead_time_s",
            ),
            MOST_EVENTS,
        ),
    ]


def _rate(count: float, km: float) -> tuple[str, str]:
    low, high = poisson_interval(int(count))
    value = f"{per_100_km(count, km):.2f} ({count:.0f})" if km > 0 else "–"
    return value, f"{per_100_km(low, km):.2f} to {per_100_km(high, km):.2f}" if km > 0 else ""


def _share(count: float, of: float) -> tuple[str, str]:
    if not of:
        return "none due", ""
    low, high = wilson_interval(int(count), int(of))
    return f"{count:.0f} of {of:.0f}", f"{100 * low:.1f} to {100 * high:.1f} %"


def _clustered(rows: pd.DataFrame, column: str) -> tuple[str, str]:
    share, low, high = clustered_share(rows[rows[column].notna()], column)
    interval = "" if math.isnan(low) else f"{100 * low:.2f} to {100 * high:.2f} %"
    return _percent(share), interval


def _percent(share: float) -> str:
    if math.isnan(share):
        return "–"
    return "100 %" if share == 1.0 else f"{min(100 * share, 99.99):.2f} %"


def _number(value: float, unit: str, decimals: int = 2) -> str:
    if math.isnan(value):
        return "–"
    return "not predicted" if math.isinf(value) else f"{value:.{decimals}f} {unit}".strip()
