"""All tables as Markdown, from the schema: `python -m analysis.table_reference > docs/tables.md`."""

from plugin.schema import TABLES, Column

_ROWS = {
    "steps": "an equipped vehicle × 0.1 s",
    "predictions": "an equipped vehicle × 0.1 s × horizon (0.5, 1, 1.5, 2 s)",
    "warnings": "a warning",
    "tracks": "a confirmed radar track × 0.1 s",
    "conflicts": "a true rear-end conflict of an equipped vehicle with its leader",
    "departures": "a true crossing of a border by the outer edge of a front wheel",
    "runs": "a run",
}
_HEADER = """# Tables

Made from the schema by `python -m analysis.table_reference > docs/tables.md`.

One file a table, CSV or Parquet, one header, SI units in the column names. An empty cell means "not
applicable" or "not known", never 0. Left is positive: offsets, headings, curvatures, rates. `true_…` is truth
that the vehicle never sees. Later versions may add columns.
"""


def reference() -> str:
    """The Markdown text."""
    parts = [_HEADER]
    for name, columns in TABLES.items():
        parts.append(f"\n## {name}\n\nA row is {_ROWS[name]}.\n\n")
        parts.append("| column | type | meaning |\n|---|---|---|\n")
        parts += [_line(column) for column in columns]
    return "".join(parts)


def _line(column: Column) -> str:
    kind = f"float, {column.decimals} decimals" if column.kind == "float" else column.kind
    return f"| `{column.name}` | {kind} | {column.description.replace('|', chr(92) + '|')} |\n"


if __name__ == "__main__":
    print(reference(), end="")
