"""What the radar can see of the bodies around: field of view, occlusion, nearest visible point."""

import numpy as np

from radar_synth import visibility_kernels as kernels
from radar_synth.radar import OwnMotion, Radar, Sightings, numbers
from sumo_net.roadside import RoadsideTable, nothing
from sumo_net.snapshot import Snapshot
from sumo_net.surroundings import Objects, Poses


def objects_in_view(
    radar: Radar, poses: Poses, snapshot: Snapshot, roadside: RoadsideTable | None = None
) -> Objects:
    """Vehicles and roadside objects that reach into the field of view of n vehicles, (n, M), nearest first.

    Hidden ones are included. Where there are more than `most_objects`, the furthest are left out. A vehicle
    itself is left out, too.
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
    """The nearest visible point of each body, exact, (n, M).

    Bodies are rectangles in the plane that move along their headings. From the faces towards the radar, the
    angular intervals that other bodies hide (whatever their height) are removed. A point is in view if any
    beam covers it. A body whose nearest visible point is below the minimum range is not seen.
    """
    out = Sightings(*np.full((len(Sightings._fields), *objects.forward_m.shape), np.nan))
    kernels.look(objects, motion, numbers(radar), out)
    return out
