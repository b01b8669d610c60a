"""One run of a campaign in a process of its own: `python -m analysis.campaign.one FOLDER`, the run on stdin.

SUMO, its memory and whatever may go wrong in it end with the process.
"""

import json
import sys
from pathlib import Path

from analysis.campaign.tally import TABLES, tally
from analysis.simulate import simulate
from plugin.record import read_table
from sumo_net.settings import SettingsError
from sumo_net.traffic import TrafficError

EVENTS = ("warnings", "departures", "conflicts")  # small: they are always kept


def one(order: dict[str, object], folder: Path) -> None:
    """Run it into `folder`: summary.json, and the tables that are kept."""
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
    (folder / "summary.json").write_text(json.dumps(summary, sort_keys=True), encoding="utf-8")


def main() -> None:
    """Entry point: what went wrong is the last line on standard error."""
    try:
        one(json.load(sys.stdin), Path(sys.argv[1]))
    except (SettingsError, TrafficError, ValueError, OSError) as error:
        print(f"{error}", file=sys.stderr)
        raise SystemExit(1) from None


if __name__ == "__main__":
    main()
