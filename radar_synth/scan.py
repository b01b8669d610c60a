"""One scan of a fleet's radars: sightings, and the detections reported of them."""

from typing import NamedTuple

from radar_synth.degrade import measure
from radar_synth.degrade_kernels import used_places
from radar_synth.radar import OwnMotion, Radar, Scan, ScanTruth, Sightings
from radar_synth.visibility import sightings
from sumo_net.arrays import Array
from sumo_net.surroundings import Objects


class Flat(NamedTuple):
    """All D detections of a fleet's scan, sorted by vehicle, (D,) each."""

    owner: Array  # int64, row of the vehicle
    column: Array  # int64, slot in the Scan (and in the ScanTruth)
    range_m: Array
    range_rate_mps: Array
    azimuth_rad: Array


def scan(
    radar: Radar, objects: Objects, motion: OwnMotion, keys: Array, counter: Array
) -> tuple[Scan, ScanTruth, Sightings]:
    """One scan of n vehicles.

    Parameters
    ----------
    objects : bodies around, from `visibility.objects_in_view`.
    keys : (n,) uint64, each vehicle's `stream_key(seed, vehicle_id, "radar")`.
    counter : (n,) int64, number of the scan.

    A vehicle's result depends only on its own rows, and not on the order of its objects.
    """
    seen = sightings(radar, objects, motion)
    reported, behind = measure(radar, objects, seen, keys, counter)
    return reported, behind, seen


def flatten(reported: Scan) -> Flat:
    """The used slots of a Scan as flat arrays, for trackers."""
    return Flat(*used_places(reported))
