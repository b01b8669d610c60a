"""The summary of a run on the terminal."""

import math

from rich.console import Console

from analysis.metrics import figure_names
from analysis.summary import _figures


def printed(**figures: float) -> dict[str, str]:
    """The summary's lines by their labels."""
    console = Console(width=200, highlight=False)
    with console.capture() as capture:
        console.print(_figures(dict.fromkeys(figure_names(), 1.0) | figures, "passenger 2 of 9"))
    lines = capture.get().splitlines()
    return {line[:23].strip(): line[23:].strip() for line in lines}


def test_times_that_were_not_predicted_are_counted() -> None:
    few = {"ttc_steps": 9, "ttc_error_median_s": 0.13, "ttc_error_p95_s": math.inf}
    lines = printed(**few, ttc_unforeseen_rate=2 / 9, tlc_error_median_s=0.01, tlc_error_p95_s=0.04)
    assert lines["TTC error below 3 s"] == "median 0.13 s, none predicted in 2 of 9 steps"
    assert lines["TLC error below 1 s"] == "median 0.01 s, 95th percentile 0.04 s"
    most = printed(
        ttc_steps=4, ttc_error_median_s=math.inf, ttc_error_p95_s=math.inf, ttc_unforeseen_rate=0.75
    )
    assert most["TTC error below 3 s"] == "median not predicted, none predicted in 3 of 4 steps"


def test_a_run_without_a_due_conflict_says_so() -> None:
    assert printed(conflicts_due=2, conflicts_due_warned=1)["warned in time"] == "1 of 2 due"
    assert printed(conflicts_due=0, conflicts_critical=7)["warned in time"].startswith("none due")
