"""The built-in highway: its settings, and its exact geometry.

The alignment is the centre line of the median: straights, circular arcs, and clothoids (curvature linear
along the line) between them. Carriageways, lanes and borders run parallel to it.
"""

import itertools
import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pydantic
from pydantic import Field
from scipy.special import fresnel

from sumo_net.arrays import Array
from sumo_net.settings import settings


@settings
class Element:
    """An element of the alignment. A clothoid's curvature changes from that of the element before it (0 if
    none) to that of the element after it.
    """

    kind: Literal["straight", "clothoid", "arc"] = Field(description="shape: straight, clothoid or arc")
    length_m: float = Field(gt=0, le=100_000, description="length along the alignment")
    radius_m: float | None = Field(None, description="radius of an arc: positive turns left, negative right")
    speed_limit_kmh: float = Field(130.0, gt=0, le=300, description="speed limit on this element")

    @pydantic.model_validator(mode="after")
    def _radius_fits_kind(self) -> "Element":
        if (self.radius_m is not None) != (self.kind == "arc"):
            raise ValueError(f"radius_m = {self.radius_m}: an arc needs one, a {self.kind} has none")
        if self.radius_m is not None and abs(self.radius_m) < 30.0:
            raise ValueError(f"radius_m = {self.radius_m}: must be at least 30 m, left or right")
        return self

    @property
    def curvature_1pm(self) -> float:
        """Curvature of a straight or an arc; not defined for a clothoid."""
        return 0.0 if self.radius_m is None else 1.0 / self.radius_m


def _straight(length_m: float, kmh: float = 130.0) -> Element:
    return Element(kind="straight", length_m=length_m, speed_limit_kmh=kmh)


def _bend(radius_m: float, length_m: float, clothoid_m: float, kmh: float) -> tuple[Element, ...]:
    clothoid = Element(kind="clothoid", length_m=clothoid_m, speed_limit_kmh=kmh)
    arc = Element(kind="arc", length_m=length_m, radius_m=radius_m, speed_limit_kmh=kmh)
    return clothoid, arc, clothoid


_DEFAULT = (
    _straight(400.0),
    *_bend(1000.0, 350.0, 130.0, 130.0),
    _straight(150.0),
    *_bend(-750.0, 300.0, 120.0, 120.0),
    _straight(100.0, 120.0),
    *_bend(2000.0, 400.0, 100.0, 130.0),
    _straight(250.0),
    _straight(100.0, 80.0),
    *_bend(-250.0, 220.0, 90.0, 80.0),  # like an exit
    _straight(50.0, 80.0),
    *_bend(500.0, 350.0, 110.0, 120.0),
    _straight(150.0),
    *_bend(-1500.0, 400.0, 100.0, 130.0),
    _straight(500.0),
)


@settings
class Highway:
    """A divided highway; both directions run side by side along the alignment."""

    lanes: int = Field(3, ge=1, le=6, description="number of lanes per direction")
    lane_width_m: float = Field(3.75, ge=2.5, le=5.0)
    median_m: float = Field(
        4.0, ge=1.0, le=60.0, description="width between the leftmost borders of both directions"
    )
    shoulder_right_m: float = Field(
        2.5, ge=0.0, le=10.0, description="width of the asphalt outside the right border"
    )
    shoulder_left_m: float = Field(
        0.75, ge=0.0, le=10.0, description="width of the asphalt outside the left border"
    )
    elements: tuple[Element, ...] = Field(_DEFAULT, min_length=1, description="along the forward direction")
    longest_edge_m: float = Field(1500.0, ge=50.0, description="longer elements are split into several edges")

    @pydantic.model_validator(mode="after")
    def _fits(self) -> "Highway":
        for before, after in itertools.pairwise(self.elements):
            if before.kind == after.kind == "clothoid":
                raise ValueError("elements: a straight or an arc must stand between two clothoids")
        if self.shoulder_left_m * 2.0 > self.median_m:
            raise ValueError(
                f"shoulder_left_m = {self.shoulder_left_m}: at most half of median_m = {self.median_m}"
            )
        half = self.median_m / 2.0 + self.lanes * self.lane_width_m + self.shoulder_right_m
        tightest = min((abs(e.radius_m) for e in self.elements if e.radius_m), default=math.inf)
        if half > 0.8 * tightest:
            raise ValueError(
                f"radius_m = {tightest}: too tight for a carriageway that extends {half:.1f} m to the side"
            )
        return self

    def lane_offset_m(self, lane: int) -> float:
        """Offset of a lane's centre (0 rightmost) from the alignment in the lane's direction: negative."""
        return -(self.median_m / 2.0 + (self.lanes - lane - 0.5) * self.lane_width_m)


@dataclass(frozen=True, slots=True, eq=False)
class Alignment:
    """Exact geometry: M elements of linear curvature. Stations are arc length, m."""

    start_m: Array  # (M + 1,) station of each element's start, then the end
    x_m: Array  # (M + 1,)
    y_m: Array
    heading_rad: Array
    curvature_1pm: Array  # (M,) at the start of each element
    rate_1pm2: Array  # (M,) curvature per metre

    @property
    def length_m(self) -> float:
        """Total length."""
        return float(self.start_m[-1])

    def pose_at(self, station_m: Array) -> tuple[Array, Array, Array, Array]:
        """(x, y, heading, curvature) at stations of any shape; straight beyond the ends."""
        s = np.asarray(station_m, dtype=float)
        i = np.clip(np.searchsorted(self.start_m, s, side="right") - 1, 0, len(self.rate_1pm2) - 1)
        inside = np.clip(s, 0.0, self.length_m)
        u = inside - self.start_m[i]
        k, c = self.curvature_1pm[i], self.rate_1pm2[i]
        step = _walk(k, c, u)
        turn = np.exp(1j * self.heading_rad[i])
        heading = self.heading_rad[i] + u * (k + 0.5 * c * u)
        z = self.x_m[i] + 1j * self.y_m[i] + turn * step + (s - inside) * np.exp(1j * heading)
        return z.real, z.imag, heading, np.where(s == inside, k + c * u, 0.0)

    def offset_pose_at(self, station_m: Array, left_m: float) -> tuple[Array, Array, Array, Array]:
        """(x, y, heading, curvature) of the parallel line left_m to the left, at the alignment's stations."""
        x, y, heading, curvature = self.pose_at(station_m)
        bend = curvature / (1.0 - left_m * curvature)
        return x - left_m * np.sin(heading), y + left_m * np.cos(heading), heading, bend

    def offset_length(self, station_m: Array, left_m: float) -> Array:
        """Arc length of that parallel line up to the alignment's stations: s − d (θ(s) − θ(0))."""
        s = np.asarray(station_m, dtype=float)
        return s - left_m * (self.pose_at(s)[2] - self.heading_rad[0])

    def station_of_offset_length(self, length_m: Array, left_m: float) -> Array:
        """The inverse of offset_length, to 1e-10 m."""
        wanted = np.asarray(length_m, dtype=float)
        s = wanted.copy()
        for _ in range(50):
            curvature = self.pose_at(s)[3]
            step = (wanted - self.offset_length(s, left_m)) / (1.0 - left_m * curvature)
            s = s + step
            if np.max(np.abs(step), initial=0.0) < 1e-10:
                break
        return s

    def reversed(self) -> "Alignment":
        """The same line driven the other way."""
        length, heading = self.length_m, self.heading_rad[::-1] + math.pi
        ends = self.curvature_1pm + self.rate_1pm2 * np.diff(self.start_m)
        return Alignment(
            length - self.start_m[::-1],
            self.x_m[::-1],
            self.y_m[::-1],
            heading,
            -ends[::-1],
            self.rate_1pm2[::-1],
        )


def alignment(elements: tuple[Element, ...]) -> Alignment:
    """The exact line of a list of elements, from the origin along +x."""
    M = len(elements)
    k, c, length = np.zeros(M), np.zeros(M), np.array([e.length_m for e in elements])
    for i, element in enumerate(elements):
        if element.kind != "clothoid":
            k[i] = element.curvature_1pm
            continue
        k[i] = elements[i - 1].curvature_1pm if i > 0 else 0.0
        after = elements[i + 1].curvature_1pm if i + 1 < M else 0.0
        c[i] = (after - k[i]) / element.length_m
    heading = np.concatenate([[0.0], np.cumsum(length * (k + 0.5 * c * length))])
    steps = np.exp(1j * heading[:-1]) * _walk(k, c, length)
    z = np.concatenate([[0.0], np.cumsum(steps)])
    return Alignment(np.concatenate([[0.0], np.cumsum(length)]), z.real, z.imag, heading, k, c)


def _walk(k: Array, c: Array, u: Array) -> Array:
    # ∫₀ᵘ exp(i (k t + c t²/2)) dt: straight, arc, or clothoid by Fresnel integrals.
    k, c, u = np.broadcast_arrays(k, c, u)
    out = u.astype(complex)
    arc = (c == 0.0) & (k != 0.0)
    out[arc] = (np.exp(1j * k[arc] * u[arc]) - 1.0) / (1j * k[arc])
    bent = c != 0.0
    sign = np.sign(c[bent])
    rate, k0, t = np.abs(c[bent]), k[bent] * sign, u[bent]  # mirrored where the rate is negative
    scale = np.sqrt(math.pi * rate)
    sin1, cos1 = fresnel((k0 + rate * t) / scale)
    sin0, cos0 = fresnel(k0 / scale)
    integral = (cos1 - cos0 + 1j * (sin1 - sin0)) * np.exp(-0.5j * k0**2 / rate) * math.pi / scale
    out[bent] = np.where(sign > 0, integral, np.conj(integral))
    return out
