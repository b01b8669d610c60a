"""One run of a campaign, to be called in a separate process.

SUMO, its memory and any crash end with the process.
"""

import json
from pathlib import Path

from analysis.campaign.store import Store
from analysis.campaign.tally import tally
from analysis.metrics import TABLES
from analysis.simulate import simulate
from plugin.record import read_table

EVENTS = ("warnings", "departures", "conflicts")  # small, so always kept


def one(order: dict[str, object], folder: Path) -> None:
    """Run `order` into `folder`: summary.json, and the tables to keep."""
    simulate(
        str(order["scenario"]),
        folder,
        changes=order["changes"],
        formats=("parquet",),
        compare_paper=bool(order["compare_paper"]),
        threads=1,
        quiet=True,
    )
    counts = tally({name: read_table(folder, name) for name in TABLES})
    for file in folder.glob("*.parquet"):
        if file.stem in TABLES and file.stem not in (*EVENTS, *order["keep"]):  # type: ignore[misc]
            file.unlink()
    summary = {"key": order["key"], "cell": order["cell"], "seed": order["seed"], "counts": counts}
    Store(folder).write_text("summary.json", json.dumps(summary, sort_keys=True))
