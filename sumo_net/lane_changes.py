"""Lane changes of unequipped vehicles: SUMO makes them in one step; to the sensors they take seconds.

Only the positions that sensors see are shifted, not SUMO's own state. Equipped vehicles change lanes by their
driver model and are not touched.
"""

import numpy as np

from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.lane_graph import LaneGraph
from sumo_net.snapshot import Snapshot
from sumo_net.step import STEP_S

CHANGE_S = 3.0


class LaneChanges:
    """Follows every vehicle's lane and spreads each change over `duration_s`."""

    def __init__(self, graph: LaneGraph, lane_ids: list[str], duration_s: float = CHANGE_S) -> None:
        """lane_ids: the list of Traffic, which may grow."""
        self._graph, self._lane_ids = graph, lane_ids
        self._steps = max(1, round(duration_s / STEP_S))
        self._lane = np.full(256, -1, np.int32)  # by handle
        self._left = np.zeros(256, np.int64)  # steps until the change is done
        self._from_m = np.zeros(256)  # metres left of the new lane at which it began

    def step(self, snapshot: Snapshot, equipped: Array) -> Snapshot:
        """The snapshot with vehicles between lanes during a change; call once a step. equipped (N,) bool."""
        handle, lane = snapshot.handle, snapshot.lane
        if not len(handle):
            return snapshot
        known = int(handle.max()) + 1
        self._lane, self._left = longer(self._lane, known, -1), longer(self._left, known)
        self._from_m = longer(self._from_m, known)
        before = self._lane[handle]
        self._lane[handle] = lane
        for i in np.flatnonzero((before != lane) & (before >= 0) & (lane >= 0) & ~equipped).tolist():
            self._begin(int(handle[i]), int(before[i]), int(lane[i]))
        self._left[handle[equipped]] = 0
        changing = np.flatnonzero(self._left[handle] > 0)
        if not len(changing):
            return snapshot
        return self._shifted(snapshot, changing)

    def _begin(self, handle: int, before: int, lane: int) -> None:
        (edge, old, old_width), (new_edge, new, width) = self._on(before), self._on(lane)
        if edge != new_edge or not edge:
            return  # driven on to the next edge
        rest = float(self._offset(np.array([handle]))[0])
        # lanes are numbered from the right
        self._from_m[handle] = rest + (old - new) * 0.5 * (old_width + width)
        self._left[handle] = self._steps

    def _offset(self, handle: Array) -> Array:
        """Metres left of SUMO's position now: a half cosine from the start of the change to 0."""
        part = self._left[handle] / self._steps
        return np.asarray(self._from_m[handle] * 0.5 * (1.0 - np.cos(np.pi * part)))

    def _shifted(self, snapshot: Snapshot, changing: Array) -> Snapshot:
        handle = snapshot.handle[changing]
        offset = self._offset(handle)
        self._left[handle] -= 1
        lateral_mps = (self._offset(handle) - offset) / STEP_S
        x, y, heading = snapshot.x_m.copy(), snapshot.y_m.copy(), snapshot.heading_rad.copy()
        x[changing] -= offset * np.sin(heading[changing])
        y[changing] += offset * np.cos(heading[changing])
        # bounded below: a vehicle that stops during a change keeps a plausible heading
        heading[changing] += np.arctan2(lateral_mps, np.maximum(snapshot.speed_mps[changing], 5.0))
        return snapshot._replace(x_m=x, y_m=y, heading_rad=heading)

    def _on(self, lane: int) -> tuple[str, int, float]:
        """Edge, index on it and width of a lane by its number."""
        known = self._graph.lanes.get(self._lane_ids[lane])
        return ("", 0, 0.0) if known is None else (known.edge, known.index, known.width_m)
