"""The true leaders of vehicles: on SUMO's lanes, and by position. For scoring only.

Time to collision is the bumper-to-bumper gap over the closing speed, as in SUMO's SSM device.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from plugin import leader_kernels as kernels
from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.ego import EgoTruth
from sumo_net.lane_chain import lanes_ahead
from sumo_net.lane_graph import LaneGraph
from sumo_net.road import RoadTable
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import Objects

NOBODY = -1
_REMEMBERED_CHAINS = 5_000


class Leaders(NamedTuple):
    """The true leader of n vehicles, (n,) each."""

    handle: Array  # int64, -1 for none
    gap_m: Array  # bumper to bumper, NaN for none
    closing_mps: Array  # NaN for none
    ttc_s: Array  # inf where there is none, or the gap opens


def nobody(n: int) -> Leaders:
    """n vehicles without a leader."""
    gap_m, closing_mps, ttc_s = np.full((3, n), np.nan)
    ttc_s[:] = np.inf
    return Leaders(np.full(n, NOBODY, np.int64), gap_m, closing_mps, ttc_s)


class LaneOrder:
    """Leaders on SUMO's lanes, across edges and junctions along each vehicle's route."""

    def __init__(
        self, graph: LaneGraph, lane_ids: list[str], route_ahead: Callable[[int], tuple[str, ...]]
    ) -> None:
        """lane_ids and route_ahead: those of Traffic."""
        self._graph, self._names, self._route = graph, lane_ids, route_ahead
        self._number: dict[str, int] = {}
        self._chains: dict[tuple[str, tuple[str, ...]], int] = {}
        self._lanes = np.full((0, 1), -1, np.int32)
        self._ahead = np.zeros((0, 1))
        self._row = np.full(256, -1, np.int64)  # by handle
        self._lane = np.full(256, -1, np.int64)  # that the row was looked up for

    def leaders(self, snapshot: Snapshot, handle: Array, reach_m: float = 200.0) -> Leaders:
        """Leaders of the vehicles `handle` (n,), all of them in the snapshot."""
        out = nobody(len(handle))
        if not len(handle):
            return out
        if len(self._chains) > _REMEMBERED_CHAINS:  # bounded: every vehicle may have a route of its own
            self._forget_chains()
        rows = np.searchsorted(snapshot.handle, handle)
        known = int(handle.max()) + 1
        self._row, self._lane = longer(self._row, known, -1), longer(self._lane, known, -1)
        lane = snapshot.lane[rows]
        for i in np.flatnonzero(self._lane[handle] != lane).tolist():
            self._lane[handle[i]] = lane[i]
            self._row[handle[i]] = self._chain(int(lane[i]), int(handle[i])) if lane[i] >= 0 else -1
        kernels.lane_leaders(
            rows, snapshot, len(self._names), self._row[handle], self._lanes, self._ahead, reach_m, out
        )
        return out

    def _forget_chains(self) -> None:
        self._chains.clear()
        self._lanes, self._ahead = np.full((0, 1), -1, np.int32), np.zeros((0, 1))
        self._row[:], self._lane[:] = -1, -1

    def _chain(self, lane: int, handle: int) -> int:
        name, route = self._names[lane], self._route(handle)
        if (name, route) not in self._chains:
            for number in range(len(self._number), len(self._names)):
                self._number[self._names[number]] = number
            names = [name, *lanes_ahead(self._graph, name, route)] if name in self._graph.lanes else [name]
            lengths = [self._graph.lanes[one].length_m for one in names[:-1]]
            width = max(self._lanes.shape[1], len(names))
            numbers, ahead = np.full((1, width), -1, np.int32), np.zeros((1, width))
            numbers[0, : len(names)] = [self._number.get(one, -1) for one in names]
            ahead[0, : len(names)] = np.cumsum([0.0, *lengths])
            self._chains[name, route] = len(self._lanes)
            self._lanes = np.concatenate([_widened(self._lanes, width, -1), numbers])
            self._ahead = np.concatenate([_widened(self._ahead, width, 0.0), ahead])
        return self._chains[name, route]


def path_leaders(
    truth: EgoTruth, objects: Objects, table: RoadTable, bumper_m: float, overlap_m: float = 0.3
) -> Leaders:
    """The nearest bodies that reach into the lanes that contain the n vehicles, whatever SUMO's lanes are."""
    out = nobody(len(truth.handle))
    kernels.path_leaders(truth, objects, table, bumper_m, overlap_m, out)
    return out


def warned_of(
    truth: EgoTruth,
    objects: Objects,
    table: RoadTable,
    target: Array,
    bumper_m: float,
    overlap_m: float,
    entering_s: float,
) -> Leaders:
    """The bodies `target` (n,), -1 for none, where they are in the way, nobody where they are not.

    In the way: in the lane of the vehicle, in the one that it reaches within `entering_s`, or straight ahead.
    """
    out = nobody(len(target))
    kernels.warned_of(truth, objects, table, target, bumper_m, overlap_m, entering_s, out)
    return out


def in_view(objects: Objects, share: Array, target: Array, least_share: float = 0.05) -> Array:
    """Whether the bodies `target` (n,) are in the radar's view; share (n, M) as in Sightings."""
    out: Array = kernels.in_view(objects.handle, share, target, least_share)
    return out


def overlapped(objects: Objects, target: Array) -> Array:
    """Whether another vehicle's body overlaps that of `target` (n,), -1 for none: one of them is not there.

    SUMO's vehicles may pass through each other after a collision, and where they change lanes at once.
    """
    out: Array = kernels.overlapped(objects, target)
    return out


def _widened(table: Array, width: int, fill: float) -> Array:
    more = np.full((len(table), width - table.shape[1]), fill, table.dtype)
    return np.concatenate([table, more], axis=1)
