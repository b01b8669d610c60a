"""Write the page of a directory: the entry point for the command and notebooks."""

from collections.abc import Callable, Sequence
from pathlib import Path

from analysis.report.campaign_page import campaign_page
from analysis.report.page import write_html
from analysis.report.reading import kind_of
from analysis.report.recording_page import recording_page
from analysis.report.run_page import run_page
from plugin.configuration import versions

PAGE = "report.html"


def write_report(
    directory: Path,
    out: Path | None = None,
    *,
    vehicles: Sequence[str] = (),
    frames: bool = True,
    tell: Callable[[str], None] = lambda text: None,
) -> Path:
    """Write the page of a run, a campaign or a recorded drive; gives its path (by default DIR/report.html).

    vehicles, frames : drives that the viewer shows, for a run: see `run_page`.
    tell : receives progress messages of one line each.

    Raises ReportError if the directory holds nothing to show or the page cannot be written, DriveError for a
    vehicle that the run does not have.
    """
    directory = Path(directory)
    kind = kind_of(directory)
    if kind == "campaign":
        page = campaign_page(directory)
    elif kind == "recording":
        page = recording_page(directory)
    else:
        page = run_page(directory, vehicles, frames, tell)
    for note in page.notes:
        tell(f"note: {note}")
    return write_html(page, Path(out) if out is not None else directory / PAGE, versions())
