"""What of the bodies around is in view of the radar: field of view, occlusion, nearest visible point."""

from typing import Any

import numpy as np

from radar_synth import visibility_kernels as kernels
from radar_synth.radar import OwnMotion, Radar, Sightings, numbers
from sumo_net.roadside import RoadsideTable, nothing
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import Objects, Poses

Array = np.ndarray[Any, Any]


def objects_in_view(
    radar: Radar, poses: Poses, snapshot: Snapshot, roadside: RoadsideTable | None = None
) -> Objects:
    """Vehicles and roadside objects that reach into the field of view of n vehicles, (n, M), nearest first.

    Those that are hidden are in it as well. Where there are more than `most_objects`, the furthest are left
    out; a vehicle never sees itself.
    """
    handle, parts = kernels.gather(
        poses.handle,
        poses.x_m,
        poses.y_m,
        poses.heading_rad,
        snapshot,
        roadside or nothing(),
        numbers(radar),
        radar.most_objects,
    )
    return Objects(handle, *parts)


def sightings(radar: Radar, objects: Objects, motion: OwnMotion) -> Sightings:
    """The nearest visible point of each body, exactly, (n, M).

    Bodies are boxes on the plane. Of a body's faces towards the radar, what other bodies hide (whatever their
    height) is taken away as angular intervals; a beam adds its sector to its range. Bodies move along their
    own heading. A body of which the nearest visible point is nearer than the least range is not seen.
    """
    out = Sightings(*np.full((len(Sightings._fields), *objects.forward_m.shape), np.nan))
    kernels.look(objects, motion, numbers(radar), out)
    return out
