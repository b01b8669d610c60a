"""The page of a campaign, from the CSV files of its report."""

import json
from pathlib import Path

import pandas as pd

from analysis.plots import campaign as figures
from analysis.report.cards import Card, Grid, Page, card, grid_of
from analysis.report.reading import read_csv

TABLES = (
    "rates",
    "shares",
    "accuracy",
    "predictions",
    "times",
    "classes",
    "benefit",
    "differences",
    "runs",
    "failures",
)
_TIMES = {
    "true_tlc": (
        "Times to lane crossing",
        "True times to lane crossing under 5 s, of all steps before a crossing, by cell.",
    ),
    "true_ttc": (
        "Times to collision",
        "True times to collision with the leader under 10 s, of all steps, by cell.",
    ),
    "ldw_lead_time": ("Lead of lane-departure warnings", "From the warning to the crossing; negative: late."),
    "conflict_min_ttc": (
        "Least time to collision of conflicts",
        "The least true time of each conflict, by cell.",
    ),
}
MOST_ROWS = 400


def campaign_page(directory: Path) -> Page:
    """The page of the campaign in `directory`; notes name missing parts of its report."""
    notes: list[str] = []
    if not (directory / "rates.csv").is_file():
        notes += _report_first(directory)
    tables = {name: read_csv(directory, f"{name}.csv", notes) for name in TABLES}
    missing = [name for name in TABLES if not (directory / f"{name}.csv").is_file()]
    if missing:
        notes.append(f"The report lacks {', '.join(f'{name}.csv' for name in missing)}")
    sweeps = {kind: read_csv(directory, f"sweep_{kind}.csv", notes) for kind in ("ldw", "fcw")}
    about = _about(directory, notes)
    title = str(about.get("title") or directory.resolve().name)
    page = Page(title, "A campaign: many runs of lane-departure and rear-end warning in SUMO")
    page.facts = _facts(tables, about)
    planned = about.get("runs")
    done = len(tables["runs"])
    if isinstance(planned, int) and done < planned:
        notes.append(f"{done} of {planned} runs are done: the same batch command continues from there")
    if len(tables["failures"]):
        notes.append(
            f"Failed runs: {len(tables['failures'])}, with their causes in the table of failures below"
        )
    page.figures = _whole(tables)
    page.cards = _cards(tables, sweeps)
    page.events = _tables(tables, sweeps)
    page.notes = notes
    return page


def _report_first(directory: Path) -> list[str]:
    """Write the campaign's report if there are only runs."""
    from analysis.campaign.report import write_report
    from sumo_net.settings import SettingsError

    try:
        write_report(directory)
    except (SettingsError, OSError, KeyError, ValueError) as error:
        return [f"The campaign's report cannot be made: {error}"]
    return []


def _about(directory: Path, notes: list[str]) -> dict[str, object]:
    path = directory / "campaign.json"
    if not path.is_file():
        return {}
    try:
        about = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        notes.append("campaign.json cannot be read")
        return {}
    return about if isinstance(about, dict) else {}


def _facts(tables: dict[str, pd.DataFrame], about: dict[str, object]) -> list[tuple[str, str]]:
    runs, rates = tables["runs"], tables["rates"]
    facts = [("Runs", f"{len(runs)} of {about['runs']}" if "runs" in about else str(len(runs)))]
    if "cell" in runs.columns:
        facts.append(("Cells", str(runs["cell"].nunique())))
    if "seed" in runs.columns:
        facts.append(("Seeds", str(runs["seed"].nunique())))
    if len(rates) and "distance_km" in rates.columns:
        facts.append(("Driven", f"{rates['distance_km'].max():,.0f} km".replace(",", " ")))
        facts.append(("Vehicle hours", f"{rates['vehicle_hours'].max():.1f}"))
    facts.append(("Failed runs", str(len(tables["failures"]))))
    if about.get("hash"):
        facts.append(("Settings' hash", str(about["hash"])[:12]))
    return facts


def _whole(tables: dict[str, pd.DataFrame]) -> list[Grid]:
    """The figures over all cells."""
    grids = []
    rates = tables["rates"]
    if len(rates) and {"cell", "figure", "per_100km"} <= set(rates.columns):
        rows = [
            (
                figures.RATES.get(str(row["figure"]), str(row["figure"]).replace("_", " ")),
                f"{row['count']:.0f}",
                f"{row['per_100km']:.2f}",
                f"{row['per_100km_poisson_low']:.2f} to {row['per_100km_poisson_high']:.2f}",
            )
            for row in rates[rates["cell"].astype(str) == "all"].to_dict("records")
        ]
        text = "Over all cells, with exact Poisson intervals; rates.csv also has the bootstrap's by run."
        grids.append(Grid("Rates", ("event", "count", "per 100 km", "95 % interval"), rows, text))
    shares = tables["shares"]
    if len(shares) and {"cell", "share", "low"} <= set(shares.columns):
        whole = shares[(shares["cell"].astype(str) == "all") & shares["share"].notna()]
        rows = [
            (
                figures.SHARES.get(str(row["figure"]), str(row["figure"])),
                f"{row['count']:.0f} of {row['number']:.0f}",
                f"{100 * row['share']:.2f} %",
                f"{100 * row['low']:.2f} to {100 * row['high']:.2f} %",
            )
            for row in whole.to_dict("records")
        ]
        grids.append(
            Grid("Shares", ("figure", "count", "share", "95 % interval"), rows, "Wilson's intervals.")
        )
    return grids


def _cards(tables: dict[str, pd.DataFrame], sweeps: dict[str, pd.DataFrame]) -> list[Card]:
    cards = [
        card(
            "Rates by cell",
            "Events per 100 km with exact Poisson intervals; the diamond is all cells together.",
            lambda: figures.rates(tables["rates"]),
            wide=True,
        ),
        card(
            "Shares by cell",
            "Warned departures and conflicts, recognised frames, with Wilson's intervals.",
            lambda: figures.shares(tables["shares"]),
            wide=True,
        ),
        card(
            "Hits against unwanted warnings",
            "Each point is a threshold of the warning (its value beside it), evaluated on the stored runs "
            "without simulating again.",
            lambda: figures.roc(sweeps),
            wide=True,
        ),
        card(
            "Benefit of the warnings",
            "Departures and conflicts per run that reacting drivers avoid, paired by seed, with bootstrap "
            "intervals.",
            lambda: figures.benefit(tables["benefit"]),
            wide=True,
        ),
    ]
    for name, (title, text) in _TIMES.items():
        cards.append(card(title, text, lambda name=name: figures.times(tables["times"], name)))  # type: ignore[misc]
    cards += [
        card(
            "Prediction error by horizon",
            "Over all cells; quantiles from bins 12 % wide.",
            lambda: figures.prediction(tables["predictions"]),
        ),
        card(
            "Errors of the times",
            "Of the times to lane crossing (where under 1 s) and to collision (under 3 s), over all cells.",
            lambda: figures.error_times(tables["accuracy"]),
        ),
    ]
    return cards


def _tables(tables: dict[str, pd.DataFrame], sweeps: dict[str, pd.DataFrame]) -> list[Grid]:
    grids = []
    named = tables | {f"sweep_{kind}": table for kind, table in sweeps.items()}
    for name in (
        "rates",
        "shares",
        "accuracy",
        "benefit",
        "differences",
        "sweep_ldw",
        "sweep_fcw",
        "classes",
        "runs",
        "failures",
    ):
        table = named[name]
        if len(table):
            grids.append(grid_of(table, f"{name}.csv ({len(table)} rows)", table.columns, MOST_ROWS))
    return grids
