"""All published experiments by name: what `sumo-adas reproduce` runs."""

import importlib
from pathlib import Path

import pandas as pd

from analysis.published import comparison

EXPERIMENTS = {
    "simulation": "Z11 4.1: observer against the simulated vehicle, three runs; steady turn and gains of 3.2",
    "road": "Z11 4.2: three drives on a rendered road, position, motion and path 2 s ahead, both chains",
    "recognition": "Z11 conclusion 1: lane recognition in good and complex conditions, in traffic",
    "search-times": "Z11 table 4: generations and time of the search per frame",
    "correction": "Z11 eq. 13, figure 13: correction factor of the steer angle over speed",
    "imm": "IMM source, section 4: CV, CA and IMM on 400 Monte-Carlo runs",
    "adaptive": "CN104635233A: the adaptive filter, as published and in its safe form",
}


def reproduce(name: str, out: Path) -> pd.DataFrame:
    """Run one experiment; its CSV files and pictures go into `out`. Returns the comparison, see `comparison`.

    Raises ValueError for a name that is not in EXPERIMENTS.
    """
    if name not in EXPERIMENTS:
        raise ValueError(f"experiment = {name!r}: known are {', '.join(EXPERIMENTS)}")
    module = importlib.import_module(f"analysis.published.{name.replace('-', '_')}")
    table: pd.DataFrame = module.reproduce(out)
    return table


def reproduce_all(out: Path, names: tuple[str, ...] = tuple(EXPERIMENTS)) -> pd.DataFrame:
    """Run the named experiments, each into its own folder in `out`; write and return the whole comparison."""
    tables = []
    for name in names:
        one = reproduce(name, out / name)
        one.insert(0, "experiment", name)
        tables.append(one)
        whole = pd.concat(tables, ignore_index=True)
        whole.to_csv(out / "comparison.csv", index=False, float_format="%.6g")  # kept if the next one fails
    pages = [
        f"## {name}\n\n{EXPERIMENTS[str(name)]}\n\n{comparison.markdown(one)}\n"
        for name, one in whole.groupby("experiment", sort=False)
    ]
    (out / "comparison.md").write_text("\n".join(pages), encoding="utf-8")
    return whole
