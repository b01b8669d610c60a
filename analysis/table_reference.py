"""All tables as Markdown, from the schema: `python -m analysis.table_reference > docs/tables.md`."""

from plugin.schema import TABLES, Column

_ROWS = {
    "steps": "an equipped vehicle at one step of 0.1 s",
    "predictions": "an equipped vehicle at one step and one horizon (0.5, 1, 1.5 or 2 s)",
    "warnings": "a warning",
    "tracks": "a confirmed radar track at one step (of roadside objects and clutter, one step in "
    "`recording.roadside_every`, 10 by default, but every one in which it is the warning's target)",
    "conflicts": "a true rear-end conflict of an equipped vehicle with its leader",
    "departures": "a true crossing of a border by the outer edge of a front wheel",
    "runs": "a run",
}
_HEADER = """# Tables

Generated from the schema by `python -m analysis.table_reference > docs/tables.md`.

Each table is one file, CSV or Parquet, with one header. SI units are in the column names. An empty cell
means "not applicable" or "not known", never 0. Left is positive: offsets, headings, curvatures, rates.
Columns named `true_…` hold the truth of the simulation, which the vehicle's estimators never see. Later
versions may add columns.

`plugin.record.read_table("out", "steps")` reads either format, also of interrupted runs, into a DataFrame
with these types. pandas' own `read_csv` takes a vehicle called `7` for a number and one called `NaN` for an
empty cell.

## Keys

| table | key |
|---|---|
| `steps` | `run_id`, `vehicle_id`, `time_s` |
| `predictions` | the same and `horizon_s` |
| `tracks` | the same and `track_id` |
| `conflicts`, `departures`, `warnings` | `run_id`, `vehicle_id` and the time of the event |

Times can be compared exactly: `start_s` and `end_s` of `warnings` and `conflicts` are a `time_s` of `steps`;
`crossing_s` of `departures` lies between two. `target_id` is SUMO's id of any vehicle, equipped or not.
Runs of the same scenario and seed have the same `run_id`, whatever their settings: in a campaign, add the
run's folder.

```python
from plugin.record import read_table

steps, tracks = read_table("out", "steps"), read_table("out", "tracks")
keys = ["run_id", "vehicle_id", "time_s"]
targets = steps.merge(tracks, left_on=[*keys, "fcw_track_id"], right_on=[*keys, "track_id"])
```
"""


def reference() -> str:
    """The Markdown text."""
    parts = [_HEADER]
    for name, columns in TABLES.items():
        parts.append(f"\n## {name}\n\nEach row is {_ROWS[name]}.\n\n")
        parts.append("| column | type | meaning |\n|---|---|---|\n")
        parts += [_line(column) for column in columns]
    return "".join(parts)


def _line(column: Column) -> str:
    kind = f"float, {column.decimals} decimals" if column.kind == "float" else column.kind
    return f"| `{column.name}` | {kind} | {column.description.replace('|', chr(92) + '|')} |\n"


if __name__ == "__main__":
    print(reference(), end="")
