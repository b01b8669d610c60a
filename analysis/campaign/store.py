"""Storage of a campaign's results, at any fsspec address. A run is stored completely or not at all.

campaign.json            identifies the campaign by its hash
runs/KEY/summary.json    a run's counts; beside it the tables that are kept
failed/KEY.json          why a run failed
*.csv                    the report
"""

import json
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pandas as pd
import pyarrow.parquet

from plugin.record import to_pandas
from sumo_net.settings import SettingsError


class Store:
    """A campaign's directory."""

    def __init__(self, address: str | Path) -> None:
        """Raises SettingsError for an address that fsspec does not know."""
        self.address = str(address)
        try:
            self._fs, self._root = fsspec.core.url_to_fs(self.address)
        except (ValueError, ImportError) as error:
            raise SettingsError(f"--out {self.address}: {error}") from None

    def check(self, plan_hash: str, grown: bool = False) -> bool:
        """Whether the directory is already this campaign's; False if it is new, empty or has `grown` to it.

        Raises SettingsError if it is another one's, or cannot be read. Writes nothing.
        """
        try:
            known = self.read("campaign.json")
            empty = known is not None or not self._fs.exists(self._root) or not self._fs.ls(self._root)
        except json.JSONDecodeError:
            raise SettingsError(f"{self.address}: its campaign.json is broken: name another --out") from None
        if not empty:
            raise SettingsError(f"{self.address}: is not empty, and no campaign's: name another --out")
        if known is not None and known["hash"] != plan_hash:
            if grown:
                return False
            raise SettingsError(
                f"{self.address}: holds another campaign, or this one with other settings, scenario files, "
                f"--keep or --compare-paper ('{known['title']}', {known['runs']} runs): name another --out, "
                "or remove it; only seeds, scenarios and values of the grid can be added"
            )
        return known is not None

    def claim(self, title: str, plan_hash: str, runs: int, grown: bool = False) -> None:
        """Mark the directory as this campaign's. Raises SettingsError if it is another one's."""
        if not self.check(plan_hash, grown):
            self._fs.makedirs(self._root, exist_ok=True)
            self.write("campaign.json", {"title": title, "hash": plan_hash, "runs": runs})

    def describe(self, plan: dict[str, Any]) -> None:
        """Write the description of the cells, for the report."""
        self.write("plan.json", plan)

    def description(self) -> dict[str, Any] | None:
        """What `describe` has written, None if there is none that can be read."""
        try:
            plan = self.read("plan.json")
        except json.JSONDecodeError:
            return None
        return plan if isinstance(plan, dict) else None

    def done(self) -> set[str]:
        """Keys of the finished runs."""
        folder = f"{self._root}/runs"
        if not self._fs.exists(folder):
            return set()
        names = (path.rstrip("/").rsplit("/", 1)[-1] for path in self._fs.ls(folder, detail=False))
        return {name for name in names if ".part" not in name}

    def put(self, key: str, folder: Path) -> None:
        """Move a finished run in; the last step is one rename (a copy if the store has none)."""
        part, place = f"{self._root}/runs/{key}.part-{uuid.uuid4().hex}", f"{self._root}/runs/{key}"
        self._fs.makedirs(part, exist_ok=True)
        try:
            for file in sorted(folder.iterdir(), key=lambda f: (f.name == "summary.json", f.name)):
                self._fs.put_file(str(file), f"{part}/{file.name}")
            if self._fs.exists(place):  # an attempt taken for lost was first, with the same result
                self._fs.rm(part, recursive=True)
                return
            self._fs.mv(part, place, recursive=True)
        except BaseException:
            if self._fs.exists(part):
                self._fs.rm(part, recursive=True)
            raise
        failed = f"{self._root}/failed/{key}.json"
        if self._fs.exists(failed):
            self._fs.rm(failed)

    def fail(self, key: str, cause: str, attempts: int) -> None:
        """Record why a run failed."""
        self._fs.makedirs(f"{self._root}/failed", exist_ok=True)
        self.write(f"failed/{key}.json", {"cause": cause, "attempts": attempts})

    def failures(self) -> dict[str, dict[str, Any]]:
        """Cause and attempts by key."""
        folder = f"{self._root}/failed"
        if not self._fs.exists(folder):
            return {}
        keys = sorted(
            path.rsplit("/", 1)[-1].removesuffix(".json") for path in self._fs.ls(folder, detail=False)
        )
        return {key: self.read(f"failed/{key}.json") or {} for key in keys}

    def sweep_up(self) -> None:
        """Remove the remains of interrupted moves."""
        folder = f"{self._root}/runs"
        if self._fs.exists(folder):
            for path in self._fs.ls(folder, detail=False):
                if ".part-" in path:
                    self._fs.rm(path, recursive=True)

    def summaries(self) -> Iterator[dict[str, Any]]:
        """The runs' summaries in the order of their keys."""
        for key in sorted(self.done()):
            summary = self.read(f"runs/{key}/summary.json")
            if summary is not None:
                yield summary

    def table(self, key: str, name: str) -> pd.DataFrame | None:
        """A table kept of a run, None if there is none."""
        path = f"{self._root}/runs/{key}/{name}.parquet"
        if not self._fs.exists(path):
            return None
        with self._fs.open(path, "rb") as file:
            return to_pandas(pyarrow.parquet.read_table(file))

    def read(self, name: str) -> Any:
        """A JSON file of the directory, None if there is none."""
        path = f"{self._root}/{name}"
        if not self._fs.exists(path):
            return None
        with self._fs.open(path, "r", encoding="utf-8") as file:
            return json.load(file)

    def write(self, name: str, content: Any) -> None:
        """Write a JSON file completely or not at all."""
        self.write_text(name, json.dumps(content, sort_keys=True, indent=1) + "\n")

    def write_text(self, name: str, text: str) -> None:
        """Write a file completely or not at all. Raises OSError, which names the file."""
        place = f"{self._root}/{name}"
        part = f"{place}.part-{uuid.uuid4().hex}"
        try:
            with self._fs.open(part, "w", encoding="utf-8", newline="") as file:
                file.write(text)
            self._fs.mv(part, place)
        except OSError as error:  # a full disk: Python names no file
            raise OSError(error.errno or 0, error.strerror or str(error), place) from None

    def path(self, name: str) -> str:
        """Full path of a file of the directory, on its file system."""
        return f"{self._root}/{name}"
