"""pytest plug-in: `*.scenario.toml` files are tests. Light to import: `analysis.regression` does the work."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

SUFFIX = ".scenario.toml"


def pytest_addoption(parser: pytest.Parser) -> None:
    """Options --adas-mode and --adas-update."""
    group = parser.getgroup("sumo-adas", "scenarios of sumo-adas")
    group.addoption("--adas-mode", choices=("paper", "refined"), help="mode of all scenarios, not their own")
    group.addoption(
        "--adas-update", action="store_true", help="write the golden figures instead of comparing"
    )


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> "ScenarioFile | None":
    """Collect files that end in .scenario.toml."""
    if file_path.name.endswith(SUFFIX):
        return ScenarioFile.from_parent(parent, path=file_path)
    return None


class ScenarioFile(pytest.File):
    """One file, one test."""

    def collect(self) -> Iterator["ScenarioItem"]:
        """Its one item."""
        yield ScenarioItem.from_parent(self, name=self.path.name.removesuffix(SUFFIX))


class ScenarioItem(pytest.Item):
    """Runs the scenario's seeds and compares the figures with the expected ones."""

    def runtest(self) -> None:
        """Run and compare. Raises ExpectationError, or SettingsError for an invalid file."""
        from analysis.regression import check

        option: Any = self.config.option
        check(self.path, mode=option.adas_mode, update=option.adas_update)

    def repr_failure(self, excinfo: pytest.ExceptionInfo[BaseException], style: Any = None) -> str:
        """The differences; a traceback only for other errors."""
        from analysis.regression import ExpectationError
        from sumo_net.settings import SettingsError
        from sumo_net.traffic import TrafficError

        if isinstance(excinfo.value, ExpectationError | SettingsError | TrafficError):
            return str(excinfo.value)
        return str(super().repr_failure(excinfo))

    def reportinfo(self) -> tuple[Path, int, str]:
        """File and name for reports."""
        return self.path, 0, f"scenario {self.name}"
