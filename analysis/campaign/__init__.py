"""Campaigns: thousands of runs on one machine or a cluster, and statistics over them.

From Python: `plan = load("my.toml")`, `run(plan, "out")` and `write_report("out")` do what the command does;
the last one gives the report's tables as DataFrames.
"""

from analysis.campaign.engine import run
from analysis.campaign.plan import Campaign, Plan, Run, load
from analysis.campaign.report import write_report

__all__ = ["Campaign", "Plan", "Run", "load", "run", "write_report"]
