"""Camera frames of watched vehicles on disk, with detected borders, predicted path and truth.

Each vehicle has a folder: `000000.png` and so on are its frames (all rows, lossless), `marks-000000.npz` and
so on hold what belongs to them, `tracks.csv` all its radar tracks of every scan, `vehicle.json` its id.
"""

import dataclasses
import hashlib
import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from camera_synth.render import new_frames
from plugin.chain import Moment
from plugin.configuration import Configuration
from plugin.lane.estimate import BORDER_Y
from plugin.rear_end import RearEndScorer
from plugin.record import Recorder
from plugin.schema import TABLES
from plugin.vision import Vision
from sumo_net.arrays import Array
from sumo_net.batch import select
from sumo_net.road_table import RoadAhead

FRAMES, OWNER = "frames", "vehicle.json"
_EVERY_STATION = 3  # every third station of the sampled road ahead; enough for a map of it
_SLUG_LENGTH = 60


@dataclass(frozen=True, slots=True)
class Watch:
    """Vehicles whose frames are kept: the named ones, and the first `count` others on the road."""

    directory: Path  # a folder is made in it for each vehicle
    ids: frozenset[str] = frozenset()
    count: int = 0
    alone: bool = False  # others drive, but sense nothing; only where no driver reacts to warnings


class Look(NamedTuple):
    """Camera frames of k vehicles in one step, their estimates, and the truth."""

    frame: Array  # (k, 240, 320) uint8
    path_m: Array  # (k, H, 2) predicted path: forward, left
    border_px: Array  # (k, 2, R) columns of the left and right marking at BORDER_Y; NaN: not seen that far
    bodies_m: Array  # (k, M, 5) truth: forward, left of the centre, heading, length, width; NaN for unused
    road_m: Array  # (k, B, J, 2) truth: forward, left of the painted lines; NaN for unused
    road_kind: Array  # (k, B, J) int8


def look(vision: Vision, now: Moment, rows: Array) -> Look:
    """Full frames of the vehicles in `rows` (k,), and what belongs to them."""
    frames = new_frames(len(rows))
    scene = select(now.scene, rows)
    vision.draw(frames, select(now.vision, rows), scene)
    path = np.stack([now.path.forward_m[rows], now.path.left_m[rows]], axis=-1)
    road, kind = _lines(scene.ahead)
    o = scene.objects
    bodies = np.stack([o.forward_m, o.left_m, o.heading_rad, o.length_m, o.width_m], axis=-1)
    seen = vision.seen_to(select(now.after, rows))
    borders = np.where(seen[:, None, :], now.sight.columns[rows], np.nan)
    whole = Look(frames, path, borders, bodies, road, kind)
    return Look._make(part.astype(np.float32) if part.dtype == np.float64 else part for part in whole)


class Capture:
    """Follows the watched vehicles of a run."""

    def __init__(self, watch: Watch, vision: Vision, configuration: Configuration, run_id: str) -> None:
        self._watch, self._vision = watch, vision
        self._run_id = run_id
        self._about = {
            "run_id": run_id,
            "configuration_hash": configuration.hash,
            "camera": dataclasses.asdict(configuration.camera),
        }
        self._films: dict[str, _Film] = {}
        self._watched: dict[int, str] = {}  # id by handle
        self._others = 0

    def arrived(self, names: dict[int, str]) -> None:
        """Make folders for the watched ones among new equipped vehicles, names by handle."""
        for handle, name in names.items():
            named = name in self._watch.ids
            if named or self._others < self._watch.count:
                self._others += not named
                self._watched[handle] = name

    def watched(self, handle: Array) -> Array:
        """(n,) bool: whether the vehicle's frames are kept."""
        return np.isin(handle, np.fromiter(self._watched, np.int64, len(self._watched)))

    def add(self, time_s: float, now: Moment, rear_end: RearEndScorer) -> None:
        """Draw and keep the frames of the watched ones among the n vehicles."""
        rows = np.flatnonzero(self.watched(now.handle))
        if not len(rows):
            return
        seen = look(self._vision, now, rows)
        for k, row in enumerate(rows.tolist()):
            name = self._watched[int(now.handle[row])]
            film = self._films.get(name)
            if film is None:
                film = self._films[name] = _Film(self._watch.directory, name, self._run_id, self._about)
            film.add(time_s, select(seen, k))
            film.tracks.append("tracks", rear_end.latest_of(int(now.handle[row])))

    def settle(self) -> None:
        """Write what is in memory."""
        for film in self._films.values():
            film.settle()

    def close(self) -> None:
        """Write what is left; safe to call twice."""
        for film in self._films.values():
            film.settle()
            film.tracks.close()


class _Film:
    """One vehicle's folder."""

    def __init__(self, directory: Path, name: str, run_id: str, about: dict[str, Any]) -> None:
        self._folder = directory / folder_name(name)
        if (self._folder / OWNER).exists():  # of an earlier run
            shutil.rmtree(self._folder)
        self._folder.mkdir(parents=True, exist_ok=True)
        self._count = 0
        self._marks: list[tuple[float, Look]] = []
        write_owner(self._folder, {"vehicle_id": name, **about})
        self.tracks = Recorder(run_id, self._folder, ("csv",), {"tracks": TABLES["tracks"]})

    def add(self, time_s: float, seen: Look) -> None:
        _, png = cv2.imencode(".png", seen.frame, (cv2.IMWRITE_PNG_COMPRESSION, 1))
        (self._folder / f"{self._count:06}.png").write_bytes(png.tobytes())
        self._marks.append((time_s, seen))
        self._count += 1

    def settle(self) -> None:
        marks, self._marks = self._marks, []
        if marks:
            first = self._count - len(marks)
            columns: dict[str, Any] = {
                name: np.stack([getattr(seen, name) for _, seen in marks])
                for name in Look._fields
                if name != "frame"
            }
            times = np.array([time_s for time_s, _ in marks])
            np.savez_compressed(
                self._folder / f"marks-{first:06}.npz", time_s=times, border_rows=BORDER_Y, **columns
            )


def folder_name(vehicle_id: str) -> str:
    """A folder name that is safe for any id: its plain characters and a part of its SHA-256."""
    legible = re.sub(r"[^A-Za-z0-9_-]+", "_", vehicle_id)[:_SLUG_LENGTH]
    digest = hashlib.sha256(vehicle_id.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    return f"{legible}-{digest}"


def write_owner(folder: Path, about: dict[str, Any]) -> None:
    """Write `vehicle.json`."""
    (folder / OWNER).write_text(json.dumps(about, indent=1), encoding="utf-8")


def clear(directory: Path) -> None:
    """Remove the frames of an earlier run, but no files of other origin."""
    for owner in directory.glob(f"*/{OWNER}"):
        shutil.rmtree(owner.parent)


def _lines(ahead: RoadAhead) -> tuple[Array, Array]:
    """The painted lines of n roads: (n, B, J, 2) forward and left, NaN where there is none; their kinds."""
    part = select(ahead, (slice(None), slice(None, None, _EVERY_STATION)))
    offset = part.border_offset_m
    forward = part.forward_m[..., None] - offset * np.sin(part.heading_rad)[..., None]
    left = part.left_m[..., None] + offset * np.cos(part.heading_rad)[..., None]
    points = np.stack([forward, left], axis=-1).transpose(0, 2, 1, 3)
    return points, np.ascontiguousarray(part.border_kind.transpose(0, 2, 1))
