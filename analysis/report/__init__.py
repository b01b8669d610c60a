"""The report page: a run, a campaign or a recorded drive as one HTML file for any browser."""

from analysis.report.reading import ReportError
from analysis.report.write import write_report

__all__ = ["ReportError", "write_report"]
