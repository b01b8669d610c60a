"""Safe distances to a leader: the published models by name, and time to collision.

Each model gives two gaps: below the first the driver is reminded (lift off), below the second warned of
danger (brake). v and a are the own speed and acceleration, v_l and a_l the leader's, along the lane, in m/s
and m/s²; c = v - v_l is the closing speed. The road surface scales the decelerations by a share; times that
a model gives directly are divided by it.

The coefficients are those commonly quoted in the literature, written down without the papers at hand; all
are settings.
"""

import math
from typing import Literal, NamedTuple

from pydantic import Field

from sumo_net.compile import kernel
from sumo_net.settings import kernel_view, settings

ModelName = Literal["mazda", "honda", "berkeley", "camp", "ttc"]
MODELS: tuple[ModelName, ...] = ("mazda", "honda", "berkeley", "camp", "ttc")
SurfaceName = Literal["dry", "wet", "snow"]
SURFACES: tuple[SurfaceName, ...] = ("dry", "wet", "snow")
MAZDA, HONDA, BERKELEY, CAMP, TTC = range(5)

_G = 9.80665


@settings
class SafeDistance:
    """The safe-distance model, the surface, and the models' parameters."""

    model: ModelName = Field("camp", description="safe-distance model: mazda, honda, berkeley, camp, ttc")
    surface: SurfaceName = Field("dry", description="road surface, selected by the driver: dry, wet, snow")
    wet_share: float = Field(
        0.7, gt=0, le=1, description="deceleration on a wet surface over that on a dry one"
    )
    snow_share: float = Field(0.35, gt=0, le=1, description="deceleration on snow over that on a dry surface")

    mazda_own_mps2: float = Field(6.0, gt=0, description="α₁, own deceleration")
    mazda_leader_mps2: float = Field(8.0, gt=0, description="α₂, the leader's deceleration")
    mazda_system_s: float = Field(0.1, ge=0, description="τ₁, delay of the system")
    mazda_driver_s: float = Field(0.6, ge=0, description="τ₂, delay of the driver")
    mazda_least_m: float = Field(5.0, ge=0, description="d₀, remaining gap")
    mazda_margin_m: float = Field(5.0, ge=0, description="ε, distance from danger to reminder")

    honda_time_s: float = Field(2.2, gt=0, description="time of the reminder")
    honda_least_m: float = Field(6.2, ge=0, description="distance of the reminder")
    honda_mps2: float = Field(7.8, gt=0, description="α₁ = α₂, decelerations")
    honda_system_s: float = Field(0.5, ge=0, description="τ₁, delay of the system")
    honda_braking_s: float = Field(1.5, gt=0, description="τ₂, duration of braking")

    berkeley_mps2: float = Field(6.0, gt=0, description="α, deceleration of both vehicles")
    berkeley_s: float = Field(1.2, gt=0, description="τ, delay of driver (1.0 s) and system (0.2 s)")
    berkeley_least_m: float = Field(5.0, ge=0, description="d₀, remaining gap")

    camp_reminder_s: float = Field(1.9, ge=0, description="delay to braking: driver 1.52 s, system 0.38 s")
    camp_danger_s: float = Field(0.9, ge=0, description="the same for a driver who was reminded")
    camp_least_m: float = Field(1.0, ge=0, description="remaining gap")

    ttc_reminder_s: float = Field(2.8, gt=0, description="time to collision of the reminder")
    ttc_danger_s: float = Field(1.6, gt=0, description="time to collision of the danger warning")
    ttc_reaction_s: float = Field(
        0.8, ge=0, description="the part of both times that the surface does not scale"
    )

    @property
    def share(self) -> float:
        """Share of the dry decelerations that the surface allows."""
        return {"dry": 1.0, "wet": self.wet_share, "snow": self.snow_share}[self.surface]


class SafeNumbers(NamedTuple):
    """The settings as kernels take them; names without prefix are common to the models."""

    model: int
    share: float
    mazda_own_mps2: float
    mazda_leader_mps2: float
    mazda_system_s: float
    mazda_driver_s: float
    mazda_least_m: float
    mazda_margin_m: float
    honda_time_s: float
    honda_least_m: float
    honda_mps2: float
    honda_system_s: float
    honda_braking_s: float
    berkeley_mps2: float
    berkeley_s: float
    berkeley_least_m: float
    camp_reminder_s: float
    camp_danger_s: float
    camp_least_m: float
    ttc_reminder_s: float
    ttc_danger_s: float
    ttc_reaction_s: float


def numbers(s: SafeDistance) -> SafeNumbers:
    """The kernel's view of the settings."""
    return kernel_view(SafeNumbers, s, model=MODELS.index(s.model))


@kernel
def _root(gap, closing, gain):  # type: ignore[no-untyped-def]
    """First time at which closing t + gain t²/2 = gap; inf if never. In a form without cancellation."""
    square = closing * closing + 2.0 * gain * gap
    if square < 0.0:
        return math.inf
    below = closing + math.sqrt(square)
    return 2.0 * gap / below if below > 0.0 else math.inf


@kernel
def time_to_collision(gap, v, a, v_l, a_l):  # type: ignore[no-untyped-def]
    """Time until the gap is closed at constant accelerations; inf if it never is, 0 if there is no gap.

    A braking vehicle stops and does not go backwards. a = a_l = 0 gives the gap over the
    closing speed.
    """
    if gap <= 0.0:
        return 0.0
    stop = v / -a if a < 0.0 else math.inf
    stop_l = v_l / -a_l if a_l < 0.0 else math.inf
    t = _root(gap, v - v_l, a - a_l)
    if t <= min(stop, stop_l):
        return t
    if stop <= stop_l:
        return math.inf
    return _root(gap + v_l * v_l / (-2.0 * a_l), v, a)


@kernel
def mazda(v, v_l, p):  # type: ignore[no-untyped-def]
    """(v²/α₁ - v_l²/α₂)/2 + v τ₁ + c τ₂ + d₀ (Doi et al. 1994, as in Seiler, Song, Hedrick, SAE 980853)."""
    brake = 0.5 * (v * v / p.mazda_own_mps2 - v_l * v_l / p.mazda_leader_mps2) / p.share
    danger = brake + v * p.mazda_system_s + (v - v_l) * p.mazda_driver_s + p.mazda_least_m
    return danger + p.mazda_margin_m, danger


@kernel
def honda(v, v_l, p):  # type: ignore[no-untyped-def]
    """2.2 c + 6.2; c τ₂ + τ₁ τ₂ α - α τ₁²/2, or where the leader stops within τ₂,
    v τ₂ - α (τ₂ - τ₁)²/2 - v_l²/(2 α) (Fujita et al. 1995, as in Seiler, Song, Hedrick, SAE 980853).
    """
    c, alpha, t1, t2 = v - v_l, p.honda_mps2, p.honda_system_s, p.honda_braking_s
    if v_l / alpha >= t2:
        danger = c * t2 + t1 * t2 * alpha - 0.5 * alpha * t1 * t1
    else:
        danger = v * t2 - 0.5 * alpha * (t2 - t1) ** 2 - v_l * v_l / (2.0 * alpha)
    return p.honda_time_s * c / p.share + p.honda_least_m, danger / p.share


@kernel
def berkeley(v, v_l, p):  # type: ignore[no-untyped-def]
    """(v² - v_l²)/(2 α) + v τ + d₀; c τ + α τ²/2 (Seiler, Song, Hedrick, SAE 980853)."""
    alpha, tau = p.berkeley_mps2, p.berkeley_s
    reminder = 0.5 * (v * v - v_l * v_l) / (alpha * p.share) + v * tau + p.berkeley_least_m
    return reminder, ((v - v_l) * tau + 0.5 * alpha * tau * tau) / p.share


@kernel
def _camp_range(v, a, v_l, a_l, delay, p):  # type: ignore[no-untyped-def]
    # Gap used up during the delay, at constant accelerations, and after it.
    stop = min(delay, v / -a) if a < 0.0 else delay
    stop_l = min(delay, v_l / -a_l) if a_l < 0.0 else delay
    way = v * stop + 0.5 * a * stop * stop
    way_l = v_l * stop_l + 0.5 * a_l * stop_l * stop_l
    v1, v2 = max(v + a * stop, 0.0), max(v_l + a_l * stop_l, 0.0)
    if stop < delay:
        v1 = 0.0
    if stop_l < delay:
        v2 = 0.0
    moving = 0.080 if v2 > 0.0 else 0.0
    # In g; bounded so that the driver always brakes.
    need = -0.165 + 0.685 * min(a_l, 0.0) / _G + moving - 0.00889 * (v1 - v2)
    brake = -min(need, -0.05) * _G * p.share
    used = way - way_l
    if v1 <= v2 and a_l >= -brake:
        return used
    if v2 <= 0.0:
        return used + v1 * v1 / (2.0 * brake)
    if a_l > -brake:
        same = (v1 - v2) / (a_l + brake)  # time of equal speeds
        if a_l >= 0.0 or same <= v2 / -a_l:
            return used + 0.5 * (v1 - v2) * same
    return used + v1 * v1 / (2.0 * brake) - v2 * v2 / (-2.0 * a_l)


@kernel
def camp(v, a, v_l, a_l, p):  # type: ignore[no-untyped-def]
    """Delay range plus brake onset range (Kiefer et al., CAMP forward collision warning project, 1999).

    After the delay the driver brakes by -0.165 + 0.685 a_l + 0.080 (leader moving) - 0.00889 c, in g.
    """
    reminder = _camp_range(v, a, v_l, a_l, p.camp_reminder_s, p) + p.camp_least_m
    danger = _camp_range(v, a, v_l, a_l, p.camp_danger_s, p) + p.camp_least_m
    return max(reminder, danger), danger


@kernel
def _closed_within(v, a, v_l, a_l, time):  # type: ignore[no-untyped-def]
    """The largest gap that is closed within `time` at constant accelerations, at least 0."""
    most = 0.0
    stop = v / -a if a < 0.0 else math.inf
    stop_l = v_l / -a_l if a_l < 0.0 else math.inf
    equal = (v - v_l) / (a_l - a) if a_l > a else math.inf  # the gap is least at equal speeds
    for t in (time, min(time, max(equal, 0.0)), min(time, stop), min(time, stop_l)):
        t1, t2 = min(t, stop), min(t, stop_l)
        most = max(most, v * t1 + 0.5 * a * t1 * t1 - v_l * t2 - 0.5 * a_l * t2 * t2)
    return most


@kernel
def ttc(v, a, v_l, a_l, p):  # type: ignore[no-untyped-def]
    """The gaps at which the time to collision at constant accelerations falls under the two times."""
    reminder = p.ttc_reaction_s + max(p.ttc_reminder_s - p.ttc_reaction_s, 0.0) / p.share
    danger = p.ttc_reaction_s + max(p.ttc_danger_s - p.ttc_reaction_s, 0.0) / p.share
    return _closed_within(v, a, v_l, a_l, reminder), _closed_within(v, a, v_l, a_l, danger)


@kernel
def safe_distances(v, a, v_l, a_l, p):  # type: ignore[no-untyped-def]
    """(reminder, danger) m by the model chosen, never below 0; reminder is never below danger."""
    if p.model == MAZDA:
        reminder, danger = mazda(v, v_l, p)
    elif p.model == HONDA:
        reminder, danger = honda(v, v_l, p)
    elif p.model == BERKELEY:
        reminder, danger = berkeley(v, v_l, p)
    elif p.model == CAMP:
        reminder, danger = camp(v, a, v_l, a_l, p)
    else:
        reminder, danger = ttc(v, a, v_l, a_l, p)
    danger = max(danger, 0.0)
    return max(reminder, danger), danger
