"""A campaign that grows: seeds or values of its grid are added, and the runs that are there stay."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any

from analysis.campaign.plan import Plan, run_key


def described(plan: Plan, compare_paper: bool) -> dict[str, Any]:
    """What is stored beside the runs: for the report, and to recognise the campaign when it has grown."""
    marks = [hashlib.sha256(text.encode()).hexdigest()[:16] for text in plan.settings]
    return {
        "cells": list(plan.cells),
        "runs": [[one.key, one.cell, one.seed, mark] for one, mark in zip(plan.runs, marks, strict=True)],
        "keep": list(plan.campaign.keep),
        "compare_paper": compare_paper,
    }


def continued(plan: Plan, before: Mapping[str, Any] | None) -> Plan:
    """The same plan with its cells numbered as in the description `before`, new ones after those."""
    names = [cell_name(cell) for cell in plan.cells]
    known = [cell_name(cell) for cell in before["cells"]] if before else []
    if len(set(names)) < len(names) or not set(known) <= set(names):
        return plan
    order = known + [name for name in names if name not in known]
    number = [order.index(name) for name in names]
    runs = [
        dataclasses.replace(one, cell=number[one.cell], key=run_key(number[one.cell], one.seed))
        for one in plan.runs
    ]
    rows = sorted(range(len(runs)), key=lambda row: runs[row].cell)  # stable: seeds keep their order
    return dataclasses.replace(
        plan,
        cells=tuple(plan.cells[names.index(name)] for name in order),
        runs=tuple(runs[row] for row in rows),
        settings=tuple(plan.settings[row] for row in rows),
    )


def contains(now: Mapping[str, Any], before: Mapping[str, Any] | None) -> bool:
    """Whether all runs of the description `before` are unchanged in `now`, with the same tables kept."""
    if before is None or "compare_paper" not in before:
        return False
    if now["compare_paper"] != before["compare_paper"] or set(now["keep"]) != set(before["keep"]):
        return False
    return {tuple(run) for run in before["runs"]} <= {tuple(run) for run in now["runs"]}


def cell_name(cell: Mapping[str, Any]) -> str:
    """Text that two cells share only if they are the same."""
    return json.dumps(cell, sort_keys=True, default=str)
