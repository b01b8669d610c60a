"""Viewing conditions: light, weather, paint and sensor, all adjustable.

Grey values are those of the 8-bit image before noise. Lengths of patterns are on the ground. What is fixed in
the world (shadows, wear, texture, overpasses) depends only on `world_seed` and position, so that every
vehicle sees the same; what belongs to the camera (noise, drift) depends on the vehicle's key and the frame.
"""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from sumo_net.arrays import Array
from sumo_net.compile import kernel
from sumo_net.settings import settings


@settings
class Condition:
    """Light, weather and road surface. The defaults are the preset `clear`."""

    world_seed: int = Field(
        1, ge=0, lt=2**31, description="random seed of all patterns that are fixed in the world"
    )

    asphalt_grey: float = Field(98.0, ge=0, le=255, description="grey level of the road surface")
    paint_grey: float = Field(215.0, ge=0, le=255, description="grey level of a new marking")
    verge_grey: float = Field(74.0, ge=0, le=255, description="grey level of the grass beside the road")
    sky_grey: float = Field(205.0, ge=0, le=255, description="grey level of the sky above the horizon")
    haze_grey: float = Field(150.0, ge=0, le=255, description="grey level to which distant objects fade")
    visibility_m: float = Field(1500.0, gt=0, description="distance at which half of the contrast is left")

    marking_width_m: float = Field(0.15, gt=0, le=1, description="width of the lines between lanes")
    edge_width_m: float = Field(0.20, gt=0, le=1, description="width of the outermost lines")
    dash_stroke_m: float = Field(6.0, gt=0, description="painted length of a dashed line")
    dash_gap_m: float = Field(9.0, ge=0, description="unpainted length of a dashed line")

    texture: float = Field(
        4.0,
        ge=0,
        le=60,
        description="amplitude of asphalt patches in grey levels; the peak is about twice that",
    )
    wheel_tracks: float = Field(3.0, ge=0, le=60, description="grey levels by which wheel tracks are darker")
    wear: float = Field(0.0, ge=0, le=1, description="0: new paint; 1: patchy down to the asphalt")
    missing: float = Field(
        0.0, ge=0, le=0.9, description="share of the markings' length that is missing altogether"
    )

    shadow: float = Field(0.0, ge=0, le=1, description="share of the light that a tree's shadow takes")
    shadow_cover: float = Field(
        0.3, ge=0, le=1, description="share of the road in trees' shadow, approximately"
    )
    overpass: float = Field(0.0, ge=0, le=1, description="share of the light that an overpass takes")
    overpass_spacing_m: float = Field(600.0, ge=50, description="one overpass in each such length of an edge")

    ambient: float = Field(1.0, ge=0, le=2, description="gain of the daylight; 0.15 is night with headlights")
    headlight: float = Field(0.0, ge=0, le=3, description="gain of the own headlights straight ahead")
    headlight_reach_m: float = Field(
        35.0, gt=0, description="distance at which a quarter of the headlights' gain is left"
    )

    glare: float = Field(
        0.0, ge=0, le=0.9, description="share of the contrast that is lost when looking at the sun"
    )
    sun_azimuth_rad: float = Field(0.3, description="direction of the sun, counter-clockwise from +x")

    drift: float = Field(0.02, ge=0, le=0.6, description="relative amplitude of the gain's drift")
    drift_grey: float = Field(
        0.0, ge=0, le=60, description="amplitude of the black level's drift, grey levels"
    )
    drift_frames: float = Field(
        80.0, gt=1, description="number of frames between independent values of both drifts"
    )

    vignetting: float = Field(
        0.03, ge=0, le=0.8, description="share of the light that is lost in the corners"
    )
    noise_grey: float = Field(3.0, ge=0, le=60, description="standard deviation of the sensor's noise")


_PRESETS: dict[str, dict[str, Any]] = {
    "clear": {},
    # Calibrated with the published search, for which Zhang et al. 2011 report 100 % in good and over 90 % in
    # complex conditions. In the scenario `straight` (seeds 1, 2) it reaches 93.1 % in `clear`, 81.6 % here.
    "complex": {
        "asphalt_grey": 92.0,
        "visibility_m": 800.0,
        "texture": 5.0,
        "wheel_tracks": 7.0,
        "wear": 0.25,
        "missing": 0.005,
        "shadow": 0.35,
        "shadow_cover": 0.2,
        "overpass": 0.6,
        "glare": 0.2,
        "drift": 0.2,
        "drift_grey": 10.0,
        "vignetting": 0.15,
        "noise_grey": 4.0,
    },
    "harsh": {
        "asphalt_grey": 92.0,
        "paint_grey": 190.0,
        "visibility_m": 500.0,
        "texture": 8.0,
        "wheel_tracks": 7.0,
        "wear": 0.6,
        "missing": 0.06,
        "shadow": 0.55,
        "shadow_cover": 0.3,
        "overpass": 0.75,
        "glare": 0.45,
        "drift": 0.25,
        "drift_grey": 10.0,
        "vignetting": 0.15,
        "noise_grey": 8.0,
    },
    "night": {
        "ambient": 0.16,
        "headlight": 1.3,
        "sky_grey": 40.0,
        "haze_grey": 20.0,
        "visibility_m": 300.0,
        "noise_grey": 6.0,
        "drift": 0.05,
    },
    "overpass": {"overpass": 0.8, "overpass_spacing_m": 250.0},
    "shadows": {"shadow": 0.6, "shadow_cover": 0.4},
    "glare": {"glare": 0.65, "visibility_m": 500.0, "noise_grey": 4.0},
    "worn": {"wear": 0.9, "missing": 0.15, "texture": 8.0},
    "rain": {
        "asphalt_grey": 70.0,
        "paint_grey": 150.0,
        "haze_grey": 140.0,
        "visibility_m": 120.0,
        "texture": 6.0,
        "noise_grey": 5.0,
    },
    # a meteorological visibility (5 % of the contrast left) of 150 m, and no direct light
    "fog": {
        "asphalt_grey": 85.0,
        "paint_grey": 165.0,
        "sky_grey": 165.0,
        "haze_grey": 165.0,
        "visibility_m": 35.0,
        "drift": 0.05,
        "noise_grey": 4.0,
    },
}

PRESETS = tuple(_PRESETS)


def preset_settings(name: str) -> dict[str, Any]:
    """Settings of a preset that differ from `clear`. Raises ValueError for a name that is not in PRESETS."""
    if name not in _PRESETS:
        raise ValueError(f"condition = {name!r}: known are {', '.join(PRESETS)}")
    return dict(_PRESETS[name])


def preset(name: str, **changes: Any) -> Condition:
    """A preset with some settings changed. Raises ValueError for a name that is not in PRESETS."""
    return Condition(**{**preset_settings(name), **changes})


class Looks(NamedTuple):
    """Conditions as kernels take them: the settings of each of n vehicles, (n,) each."""

    world_seed: Array  # int64; the others float64, named as in Condition
    asphalt_grey: Array
    paint_grey: Array
    verge_grey: Array
    sky_grey: Array
    haze_grey: Array
    visibility_m: Array
    marking_width_m: Array
    edge_width_m: Array
    dash_stroke_m: Array
    dash_gap_m: Array
    texture: Array
    wheel_tracks: Array
    wear: Array
    missing: Array
    shadow: Array
    shadow_cover: Array
    overpass: Array
    overpass_spacing_m: Array
    ambient: Array
    headlight: Array
    headlight_reach_m: Array
    glare: Array
    sun_azimuth_rad: Array
    drift: Array
    drift_grey: Array
    drift_frames: Array
    vignetting: Array
    noise_grey: Array


class Look(NamedTuple):
    """The same for one vehicle, as scalars."""

    world_seed: int
    asphalt_grey: float
    paint_grey: float
    verge_grey: float
    sky_grey: float
    haze_grey: float
    visibility_m: float
    marking_width_m: float
    edge_width_m: float
    dash_stroke_m: float
    dash_gap_m: float
    texture: float
    wheel_tracks: float
    wear: float
    missing: float
    shadow: float
    shadow_cover: float
    overpass: float
    overpass_spacing_m: float
    ambient: float
    headlight: float
    headlight_reach_m: float
    glare: float
    sun_azimuth_rad: float
    drift: float
    drift_grey: float
    drift_frames: float
    vignetting: float
    noise_grey: float


@kernel
def look_of(looks, i):  # type: ignore[no-untyped-def]
    """Vehicle i's Look."""
    return Look(
        looks.world_seed[i],
        looks.asphalt_grey[i],
        looks.paint_grey[i],
        looks.verge_grey[i],
        looks.sky_grey[i],
        looks.haze_grey[i],
        looks.visibility_m[i],
        looks.marking_width_m[i],
        looks.edge_width_m[i],
        looks.dash_stroke_m[i],
        looks.dash_gap_m[i],
        looks.texture[i],
        looks.wheel_tracks[i],
        looks.wear[i],
        looks.missing[i],
        looks.shadow[i],
        looks.shadow_cover[i],
        looks.overpass[i],
        looks.overpass_spacing_m[i],
        looks.ambient[i],
        looks.headlight[i],
        looks.headlight_reach_m[i],
        looks.glare[i],
        looks.sun_azimuth_rad[i],
        looks.drift[i],
        looks.drift_grey[i],
        looks.drift_frames[i],
        looks.vignetting[i],
        looks.noise_grey[i],
    )


def looks(condition: Condition, count: int) -> Looks:
    """One condition for `count` vehicles; `batch.join` combines fleets with different ones."""
    numbers = dataclasses.asdict(condition)
    seed = np.full(count, numbers.pop("world_seed"), np.int64)
    return Looks(seed, **{name: np.full(count, float(value)) for name, value in numbers.items()})
