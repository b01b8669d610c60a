"""A campaign from Python: do drivers who heed their warnings leave the lane less often? About a minute.

    python docs/campaign_example.py [OUT]

Few and short runs: enough to see the tables, not enough for an answer. Run again, it finds the runs there.
"""

import sys

from analysis.campaign import Campaign, run, write_report
from analysis.campaign.plan import plan

CAMPAIGN = Campaign(
    title="Do heeded warnings help?",
    scenarios=("distraction",),
    seeds=(1, 2),
    duration_s=10.0,
    settings={"equipment.fraction": 0.1},
    grid={"reaction.on": (False, True)},  # two arms with the same seeds
)


def main() -> None:
    """Run it, and look at three of its tables."""
    out = sys.argv[1] if len(sys.argv) > 1 else "out/campaign_example"
    failures = run(plan(CAMPAIGN), out, workers=2, tell=lambda at: print(f"{at.done} of {at.total} runs"))
    tables = write_report(out)  # pandas DataFrames by name; the same as CSV files in `out`
    rates = tables["rates"]
    shown = ["cell", "reaction.on", "count", "per_100km", "per_100km_poisson_low", "per_100km_poisson_high"]
    print(rates.loc[rates["figure"] == "departures", shown].to_string(index=False))
    print(tables["benefit"].to_string(index=False))
    print(
        tables["runs"][["run", "cell", "seed", "vehicles", "departures", "warnings"]].to_string(index=False)
    )
    print("failed:", failures or "none")


if __name__ == "__main__":
    main()
