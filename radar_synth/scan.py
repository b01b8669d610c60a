"""One scan of a fleet's radars: what is in view, and what is reported of it."""

from typing import Any, NamedTuple

import numpy as np

from radar_synth.degrade import measure
from radar_synth.degrade_kernels import used_places
from radar_synth.radar import OwnMotion, Radar, Scan, ScanTruth, Sightings
from radar_synth.visibility import sightings
from sumo_net.surroundings import Objects

Array = np.ndarray[Any, Any]


class Flat(NamedTuple):
    """The detections of a fleet's scan one after the other, (D,) each, by vehicle."""

    owner: Array  # int64, row of the vehicle
    column: Array  # int64, place in the Scan (and in the ScanTruth)
    range_m: Array
    range_rate_mps: Array
    azimuth_rad: Array


def scan(
    radar: Radar, objects: Objects, motion: OwnMotion, keys: Array, counter: Array
) -> tuple[Scan, ScanTruth, Sightings]:
    """One scan of n vehicles.

    Parameters
    ----------
    objects : bodies around, for which `visibility.objects_in_view` looks.
    keys : (n,) uint64, each vehicle's `stream_key(seed, vehicle_id, "radar")`.
    counter : (n,) int64, number of the scan.

    The result of a vehicle depends on nothing but its own rows, and not on the order of its objects.
    """
    seen = sightings(radar, objects, motion)
    reported, behind = measure(radar, objects, seen, keys, counter)
    return reported, behind, seen


def flatten(reported: Scan) -> Flat:
    """The used places of a Scan as flat arrays, for trackers."""
    return Flat(*used_places(reported))
