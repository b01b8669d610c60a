"""The front radar of a fleet: settings and data types of its scans.

All values are in the vehicle's axes (ISO 8855): azimuth left of the vehicle's axis, range from the radar,
range rate positive when opening. The radar looks straight ahead.
"""

import functools
import math
from typing import NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from sumo_net.arrays import Array
from sumo_net.settings import settings


@settings
class Beam:
    """One part of the field of view: a sector symmetric to the vehicle's axis."""

    half_angle_rad: float = Field(gt=0, le=1.4, description="opening angle to each side")
    range_m: float = Field(gt=1, le=500, description="greatest range")


LONG_RANGE = Beam(half_angle_rad=math.radians(10.0), range_m=200.0)
MID_RANGE = Beam(half_angle_rad=math.radians(45.0), range_m=60.0)


@settings
class Radar:
    """A millimetre-wave radar at the front bumper. The noise is that of the publication on IMM tracking."""

    beams: tuple[Beam, ...] = Field(
        (LONG_RANGE, MID_RANGE),
        min_length=1,
        max_length=4,
        description="sectors that make up the field of view",
    )
    mount_forward_m: float = Field(
        1.6, ge=-5, le=5, description="distance of the radar ahead of the centre of gravity"
    )
    mount_left_m: float = Field(
        0.0, ge=-1.5, le=1.5, description="distance of the radar left of the vehicle's axis"
    )
    minimum_range_m: float = Field(0.5, ge=0.05, le=10, description="nearer objects are not detected")
    range_noise_m: float = Field(1.0, ge=0, le=20, description="standard deviation of the range")
    range_rate_noise_mps: float = Field(0.5, ge=0, le=10, description="standard deviation of the range rate")
    azimuth_noise_rad: float = Field(
        math.radians(0.2), ge=0, le=0.2, description="standard deviation of the azimuth, 0.2°"
    )
    snr_db: float = Field(35.0, ge=-20, le=120, description="signal-to-noise ratio of 10 m² at 100 m")
    false_alarm_probability: float = Field(
        1e-6,
        gt=0,
        lt=0.5,
        description="false-alarm probability of a cell, which sets the detection probability at a given "
        "signal",
    )
    most_likely: float = Field(0.98, ge=0, le=1, description="detection probability of the strongest echo")
    cross_section_per_m2: float = Field(
        3.7, gt=0, description="radar cross-section per visible area; a car's rear of 1.8 m × 1.5 m has 10 m²"
    )
    least_share: float = Field(
        0.05, ge=0, le=1, description="bodies of which less than this share is visible are not detected"
    )
    clutter_rate: float = Field(0.3, ge=0, le=20, description="false detections per scan, mean (Poisson)")
    clutter_rate_span_mps: float = Field(
        60.0, gt=0, description="range rates of false detections lie within ± this"
    )
    long_body_m: float = Field(
        8.0, gt=0, description="bodies of at least this length have a second reflection"
    )
    second_reflection_m: float = Field(
        7.0, gt=0, description="distance of the second reflection along the body"
    )
    second_probability: float = Field(
        0.6, ge=0, le=1, description="detection probability of the second reflection, where it is in view"
    )
    least_hiding_m: float = Field(
        0.3, ge=0, description="bodies shorter and narrower than this (posts) hide nothing"
    )
    most_objects: int = Field(
        96, ge=1, le=1000, description="largest number of bodies considered, the nearest ones"
    )
    most_detections: int = Field(
        48, ge=1, le=500, description="largest number of detections per scan, the nearest ones"
    )

    @model_validator(mode="after")
    def _nearest_before_furthest(self) -> Self:
        shortest = min(beam.range_m for beam in self.beams)
        if self.minimum_range_m >= shortest:
            raise ValueError(
                f"minimum_range_m = {self.minimum_range_m}: must be below every beam's range_m ({shortest})"
            )
        return self


class RadarNumbers(NamedTuple):
    """The radar's parameters as kernels take them."""

    beam_angle: Array  # (beams,) rad
    beam_range: Array  # (beams,) m
    forward: float
    left: float
    minimum_range: float
    range_noise: float
    rate_noise: float
    azimuth_noise: float
    snr: float  # of 1 m² at 1 m
    log_false_alarm: float
    most_likely: float
    cross_section: float
    least_share: float
    clutter: float
    clutter_span: float
    long_body: float
    second: float
    second_probability: float
    least_hiding: float


class OwnMotion(NamedTuple):
    """Motion of n equipped vehicles over ground, (n,) each."""

    speed_mps: Array  # along the vehicle's axis
    lateral_speed_mps: Array  # of the centre of gravity, left positive
    yaw_rate_rps: Array


class Sightings(NamedTuple):
    """What is visible of each body of Objects, without noise, (n, M) each; NaN where nothing is.

    The reflecting point is the nearest visible one; `second`: the one further along a long body.
    """

    range_m: Array
    range_rate_mps: Array
    azimuth_rad: Array
    width_m: Array  # visible, across the line of sight
    share: Array  # visible share of the angle that the body subtends
    second_range_m: Array
    second_range_rate_mps: Array
    second_azimuth_rad: Array
    vx_mps: Array  # velocity of the body over ground, in the vehicle's axes
    vy_mps: Array


class Scan(NamedTuple):
    """The radar's report: the first `detections` of M slots are used, nearest first; the rest are NaN."""

    detections: Array  # (n,) int64
    range_m: Array  # (n, M)
    range_rate_mps: Array
    azimuth_rad: Array


class ScanTruth(NamedTuple):
    """The truth behind each detection of a Scan, (n, M) each; the plug-in's estimators never see it."""

    handle: Array  # int64, of Objects; -1 for clutter and unused slots
    reflection: Array  # int8: 0 nearest visible point, 1 the second one of a long body, -1 clutter
    range_m: Array  # of the reflecting point; NaN for clutter, as all below
    range_rate_mps: Array
    azimuth_rad: Array
    vx_mps: Array  # of the body over ground, in the vehicle's axes
    vy_mps: Array


@functools.cache
def numbers(radar: Radar) -> RadarNumbers:
    """Kernel parameters of a radar."""
    r = radar
    return RadarNumbers(
        beam_angle=np.array([beam.half_angle_rad for beam in r.beams]),
        beam_range=np.array([beam.range_m for beam in r.beams]),
        forward=r.mount_forward_m,
        left=r.mount_left_m,
        minimum_range=r.minimum_range_m,
        range_noise=r.range_noise_m,
        rate_noise=r.range_rate_noise_mps,
        azimuth_noise=r.azimuth_noise_rad,
        snr=10.0 ** (r.snr_db / 10.0) / 10.0 * 100.0**4,
        log_false_alarm=math.log(r.false_alarm_probability),
        most_likely=r.most_likely,
        cross_section=r.cross_section_per_m2,
        least_share=r.least_share,
        clutter=r.clutter_rate,
        clutter_span=r.clutter_rate_span_mps,
        long_body=r.long_body_m,
        second=r.second_reflection_m,
        second_probability=r.second_probability,
        least_hiding=r.least_hiding_m,
    )
