"""The table reference in docs/ is current."""

from pathlib import Path

from analysis.table_reference import reference


def test_reference_is_current() -> None:
    written = Path(__file__).parents[2] / "docs" / "tables.md"
    assert written.read_text(encoding="utf-8") == reference()
