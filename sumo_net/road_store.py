"""The growing store behind the RoadTable: paths are appended; full arrays are doubled."""

from typing import Any

import numpy as np

from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.lane_chain import Piece
from sumo_net.road_fit import SmoothPath
from sumo_net.road_marking import Section
from sumo_net.road_table import MAX_BORDERS, RoadTable

_PATH = (
    "first_sample",
    "samples",
    "spacing_m",
    "own_start_m",
    "own_end_m",
    "own_length_m",
    "first_segment",
    "segments",
)
_SAMPLE = ("x_m", "y_m", "heading_rad", "curvature_1pm")
_SEGMENT = (
    "segment_start_m",
    "anchor_m",
    "stretch",
    "border_offset_m",
    "border_kind",
    "road_right_m",
    "road_left_m",
)
_INTEGERS = ("first_sample", "samples", "first_segment", "segments")


class RoadStore:
    """Appends paths. A `table` taken for kernels stays valid for its paths when more are appended."""

    def __init__(self) -> None:
        self._used = {"path": 0, "sample": 0, "segment": 0}
        self._arrays: dict[str, Array] = {}
        for name in _PATH:
            self._arrays[name] = np.zeros(16, np.int64 if name in _INTEGERS else np.float64)
        for name in _SAMPLE:
            self._arrays[name] = np.zeros(4096)
        for name in _SEGMENT:
            shape = (64, MAX_BORDERS) if name.startswith("border") else (64,)
            self._arrays[name] = np.zeros(shape, np.int8 if name == "border_kind" else np.float64)
        self.table = RoadTable(**self._arrays)

    def __len__(self) -> int:
        return self._used["path"]

    def append(
        self,
        smooth: SmoothPath,
        pieces: tuple[Piece, ...],
        sections: list[Section],
        own: int,
        own_length_m: float,
    ) -> int:
        """Add a path through lane pieces with these sections; returns its number.

        `own`: index of the path's own lane; `own_length_m`: SUMO's length of it.
        """
        knots = [_knots(piece, section) for piece, section in zip(pieces, sections, strict=True)]
        rows = sum(len(fraction) - 1 for fraction, _ in knots)
        self._grow("segment", _SEGMENT, rows)
        self._grow("sample", _SAMPLE, len(smooth.x_m))
        self._grow("path", _PATH, 1)
        path, first, segment = (self._used[kind] for kind in ("path", "sample", "segment"))
        for name in _SAMPLE:
            self._arrays[name][first : first + len(smooth.x_m)] = getattr(smooth, name)
        row = segment
        for k, (piece, section) in enumerate(zip(pieces, sections, strict=True)):
            fraction, edge_station = knots[k]
            start, end = smooth.lane_start_m[k], smooth.lane_end_m[k]
            station = start + (end - start) * (fraction - piece.begin) / (piece.end - piece.begin)
            part = slice(row, row + len(station) - 1)
            length = np.diff(station)
            self._put("segment_start_m", part, station[:-1])
            self._put("anchor_m", part, edge_station[:-1])
            self._put(
                "stretch",
                part,
                np.where(length > 0.05, np.diff(edge_station) / np.maximum(length, 0.05), 1.0),
            )
            for name in ("border_offset_m", "border_kind", "road_right_m", "road_left_m"):
                self._put(name, part, getattr(section, name))
            row = part.stop
        self._put("first_sample", path, first)
        self._put("samples", path, len(smooth.x_m))
        self._put("spacing_m", path, smooth.spacing_m)
        self._put("own_start_m", path, smooth.lane_start_m[own])
        self._put("own_end_m", path, smooth.lane_end_m[own])
        self._put("own_length_m", path, own_length_m)
        self._put("first_segment", path, segment)
        self._put("segments", path, rows)
        for kind, more in (("path", 1), ("sample", len(smooth.x_m)), ("segment", rows)):
            self._used[kind] += more
        self.table = RoadTable(**self._arrays)
        return path

    def _put(self, name: str, row: int | slice, value: Any) -> None:
        self._arrays[name][row] = value

    def _grow(self, kind: str, names: tuple[str, ...], more: int) -> None:
        needed = self._used[kind] + more
        for name in names:
            self._arrays[name] = longer(self._arrays[name], needed)


def _knots(piece: Piece, section: Section) -> tuple[Array, Array]:
    # (fractions of the lane, edge-anchored stations) that bound the segments of a piece of it.
    inside = section.fraction[(section.fraction > piece.begin) & (section.fraction < piece.end)]
    fraction = np.concatenate([[piece.begin], inside, [piece.end]])
    return fraction, np.interp(fraction, section.fraction, section.edge_station_m)
