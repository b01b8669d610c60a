"""The settings reference in docs/ is current and complete."""

import dataclasses
import re
from pathlib import Path
from typing import Any

from analysis.settings_reference import reference
from plugin.configuration import Configuration

DOCS = Path(__file__).parents[2] / "docs"


def test_reference_is_current() -> None:
    assert (DOCS / "settings.md").read_text(encoding="utf-8") == reference()


def test_every_key_of_a_configuration_stands_in_it() -> None:
    """Against the dataclasses' own asdict, which the reference does not use."""
    sections = dict(_sections(reference()))

    def look(values: dict[str, Any], name: str) -> None:
        for key, value in values.items():
            if isinstance(value, dict):
                look(value, f"{name}.{key}".lstrip("."))
            elif not (isinstance(value, tuple) and value and isinstance(value[0], dict)):
                assert f"`{key}`" in sections[name], f"{name}.{key}"

    look(dataclasses.asdict(Configuration()), "")


def _sections(text: str) -> list[tuple[str, str]]:
    parts = re.split(r"^#+ (?:Top level|`\[+([\w.]+)\]+`)$", text, flags=re.MULTILINE)
    return [(parts[i] or "", parts[i + 1]) for i in range(1, len(parts), 2)]
