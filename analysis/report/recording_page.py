"""The page of a recorded drive, from the output of `detect` or `track`."""

from pathlib import Path

import pandas as pd

from analysis.plots import recording as figures
from analysis.report.cards import Page, card, grid_of
from analysis.report.reading import read_csv


def recording_page(directory: Path) -> Page:
    """The page of a recorded drive; one of lanes.csv and tracks.csv may be missing."""
    notes: list[str] = []
    lanes = read_csv(directory, "lanes.csv", notes)
    tracks = read_csv(directory, "tracks.csv", notes)
    page = Page(
        f"Recorded drive: {directory.resolve().name}", "Lanes and radar tracks found in recorded data"
    )
    has_lanes, has_tracks = (directory / "lanes.csv").is_file(), (directory / "tracks.csv").is_file()
    if has_lanes:
        page.facts += _lane_facts(lanes, notes)
        page.cards.append(
            card(
                "Lane over time",
                "Offset, heading, curvature, width and score of the detected lane; gaps: no lane detected.",
                lambda: figures.lanes(lanes),
                wide=True,
            )
        )
        page.events.append(grid_of(lanes, f"lanes.csv ({len(lanes)} frames)", lanes.columns, 50))
    if has_tracks:
        page.facts += _track_facts(tracks, notes)
        page.cards.append(
            card(
                "Radar tracks over time",
                "Range, range rate and azimuth of the tracks by motion class; rings: in the vehicle's path.",
                lambda: figures.tracks(tracks),
                wide=True,
            )
        )
        page.events.append(grid_of(tracks, f"tracks.csv ({len(tracks)} rows)", tracks.columns, 50))
    page.notes = notes
    return page


def _lane_facts(lanes: pd.DataFrame, notes: list[str]) -> list[tuple[str, str]]:
    if lanes.empty or "lane_locked" not in lanes.columns:
        notes.append("lanes.csv holds no frame")
        return []
    locked = lanes["lane_locked"].astype(str).isin(("1", "True", "true"))
    facts = [("Frames", str(len(lanes))), ("Lane found", f"{100 * locked.mean():.1f} %")]
    if "lane_width_m" in lanes.columns and locked.any():
        facts.append(("Lane width, median", f"{lanes.loc[locked, 'lane_width_m'].median():.2f} m"))
    return facts


def _track_facts(tracks: pd.DataFrame, notes: list[str]) -> list[tuple[str, str]]:
    if tracks.empty or "track_id" not in tracks.columns:
        notes.append("tracks.csv holds no track")
        return []
    facts = [("Tracks", str(tracks["track_id"].nunique())), ("Rows", str(len(tracks)))]
    if "time_s" in tracks.columns:
        facts.append(("Duration", f"{tracks['time_s'].max() - tracks['time_s'].min():.1f} s"))
    return facts
