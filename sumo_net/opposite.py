"""Vehicles that overtake on the lane of the opposite direction (SUMO's opposite-direction driving).

SUMO reports them on that lane, with a lane position that falls as they drive. Here they are on a lane of
their own, `LaneGraph.against`: the same place, in their driving direction, left of their edge's lanes.
"""

import numpy as np

from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.lane_graph import LaneGraph
from sumo_net.snapshot import Snapshot
from sumo_net.traffic import Traffic


class OppositeLanes:
    """Finds the vehicles that drive against a lane's direction."""

    def __init__(self, graph: LaneGraph, traffic: Traffic) -> None:
        """Adds the lanes of `graph.against` to `traffic.lane_ids`."""
        self._traffic = traffic
        number = {name: k for k, name in enumerate(traffic.lane_ids)}
        known = sorted((number[real], lane) for real, lane in graph.against.items() if real in number)
        self._lane = np.array([k for k, _ in known], np.int32)
        self._edge = [_edge_of(graph, traffic.lane_ids[k]) for k, _ in known]
        self._against = len(number) + np.arange(len(known), dtype=np.int32)
        self._length_m = np.array([graph.lanes[lane].length_m for _, lane in known])
        traffic.lane_ids.extend(lane for _, lane in known)
        self._looked = np.zeros(0, np.int64)  # by handle: place in _lane of the present lane, -1 for none
        self._turned = np.zeros(0, np.bool_)  # by handle: whether it drives against that lane

    def step(self, snapshot: Snapshot) -> Snapshot:
        """The snapshot with such vehicles on the lanes of `LaneGraph.against`."""
        if not len(self._lane):
            return snapshot
        at = np.minimum(np.searchsorted(self._lane, snapshot.lane), len(self._lane) - 1)
        handles = snapshot.handle
        self._looked = longer(self._looked, int(handles.max(initial=-1)) + 1, -1)
        self._turned = longer(self._turned, len(self._looked))
        at[self._lane[at] != snapshot.lane] = -1
        for i in np.flatnonzero((at >= 0) & (at != self._looked[handles])).tolist():
            self._turned[handles[i]] = self._is_turned(int(handles[i]), int(at[i]))
        self._looked[handles] = at
        rows = np.flatnonzero((at >= 0) & self._turned[handles])
        if not len(rows):
            return snapshot
        lane, position = snapshot.lane.copy(), snapshot.lane_position_m.copy()
        lane[rows] = self._against[at[rows]]
        position[rows] = self._length_m[at[rows]] - position[rows]
        return snapshot._replace(lane=lane, lane_position_m=position)

    def of_lane(self, handle: Array, left_m: Array) -> Array:
        """Offsets (n,) of vehicles to their left, as offsets left of SUMO's lanes in the lanes' direction."""
        if not len(self._lane):
            return left_m
        return np.where(self._turned[handle] & (self._looked[handle] >= 0), -left_m, left_m)

    def _is_turned(self, handle: int, k: int) -> bool:
        # the route has the vehicle's own edge first; on a junction, the one before it
        return self._edge[k] not in self._traffic.route_ahead(handle)[:1]


def _edge_of(graph: LaneGraph, lane: str) -> str:
    """The edge of a lane; of an internal one, the edge before the junction."""
    seen = {lane}
    while graph.lanes[lane].internal and graph.inward.get(lane):
        lane = graph.inward[lane][0].source
        if lane in seen:
            break
        seen.add(lane)
    return graph.lanes[lane].edge
