"""Roads in closed form for tests: RoadAhead of a straight, a circle or a clothoid, and Objects."""

from collections.abc import Sequence

from sumo_net.plain_road import no_objects, road_ahead
from sumo_net.surroundings import Objects

__all__ = ["no_objects", "objects_at", "road_ahead"]


def objects_at(rows: Sequence[Sequence[dict[str, float]]], bodies: int = 8) -> Objects:
    """Objects from dictionaries, one list a vehicle; keys as Objects' fields; a car by default."""
    objects = no_objects(len(rows), bodies)
    for i, row in enumerate(rows):
        for m, body in enumerate(row):
            full = {
                "handle": m + 1,
                "heading_rad": 0.0,
                "speed_mps": 25.0,
                "length_m": 4.6,
                "width_m": 1.8,
                "height_m": 1.5,
                **body,
            }
            for name, value in full.items():
                getattr(objects, name)[i, m] = value
    return objects
