"""Vehicle parameters and the two-degree-of-freedom (single-track) model of Zhang et al. 2011, corrected.

State (v_y, γ): lateral speed at the centre of gravity in m/s, yaw rate in rad/s; input δ: front steer angle
in rad; ISO 8855, left positive. Equation (11) and the matrix A of (21) are misprinted: as printed the model
is unstable. Corrected here: the term −v in the first row, and −(l_f² k_f + l_r² k_r) in the second.
"""

from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from scipy.linalg import expm

from sumo_net.compile import kernel
from sumo_net.settings import settings

FloatArray = NDArray[np.float64]

STANDSTILL_MPS = 0.1  # the model divides by speed; here its exact discretisation is already kinematic


@settings
class Vehicle:
    """The car: table 5 of Zhang et al. 2011 at half load; overhang, wheel span and width are ours."""

    front_axle_m: float = Field(0.90, gt=0, description="l_f, centre of gravity to front axle")
    rear_axle_m: float = Field(1.06, gt=0, description="l_r, centre of gravity to rear axle")
    mass_kg: float = Field(1215.0, gt=0, description="mass: 960 empty, 1,215 half load, 1,460 full load")
    front_stiffness_npr: float = Field(
        60_000.0, gt=0, description="k_f, cornering stiffness of the front axle, N/rad"
    )
    rear_stiffness_npr: float = Field(
        60_000.0, gt=0, description="k_r, cornering stiffness of the rear axle, N/rad"
    )
    yaw_inertia_kgm2: float = Field(
        2_100.0, gt=0, description="I_z, moment of inertia about the vertical axis"
    )
    front_overhang_m: float = Field(0.70, ge=0, description="from the front axle to the front bumper")
    wheel_span_m: float = Field(
        1.50,
        gt=0,
        description="distance between the outer edges of the front wheels, of a body `width_m` wide",
    )
    width_m: float = Field(
        1.80, gt=0, description="width of the body; wheels of wider or narrower ones stand in proportion"
    )

    @model_validator(mode="after")
    def _wheels_below_the_body(self) -> Self:
        if self.wheel_span_m > self.width_m:
            raise ValueError(
                f"wheel_span_m = {self.wheel_span_m}: must be at most width_m = {self.width_m}, the width of "
                "the body that stands on these wheels"
            )
        return self

    @property
    def wheelbase_m(self) -> float:
        """L = l_f + l_r."""
        return self.front_axle_m + self.rear_axle_m

    @property
    def bumper_m(self) -> float:
        """Centre of gravity to front bumper."""
        return self.front_axle_m + self.front_overhang_m

    @property
    def rear_slip_s2pm(self) -> float:
        """m l_f / (L k_r): slip angle of the rear axle per lateral acceleration in a steady turn."""
        return self.mass_kg * self.front_axle_m / (self.wheelbase_m * self.rear_stiffness_npr)

    @property
    def understeer(self) -> float:
        """K_u = m (l_r k_r − l_f k_f) / (L k_f k_r), s²/m (below eq. 13)."""
        k_f, k_r = self.front_stiffness_npr, self.rear_stiffness_npr
        return (
            self.mass_kg * (self.rear_axle_m * k_r - self.front_axle_m * k_f) / (self.wheelbase_m * k_f * k_r)
        )


class Model(NamedTuple):
    """The single-track model's parameters as kernels take them."""

    m: float
    I: float  # noqa: E741
    l_f: float
    l_r: float
    k_f: float
    k_r: float


def model(vehicle: Vehicle) -> Model:
    """Kernel parameters of a vehicle."""
    return Model(
        vehicle.mass_kg,
        vehicle.yaw_inertia_kgm2,
        vehicle.front_axle_m,
        vehicle.rear_axle_m,
        vehicle.front_stiffness_npr,
        vehicle.rear_stiffness_npr,
    )


def steer_correction(vehicle: Vehicle, speed_mps: FloatArray | float) -> FloatArray | float:
    """f = δ_D / δ_k = 1 + K_u v² / L (eq. 13, whose print misplaces the fraction)."""
    return 1.0 + vehicle.understeer * np.square(speed_mps) / vehicle.wheelbase_m


def single_track(vehicle: Vehicle, speed_mps: float) -> tuple[FloatArray, FloatArray]:
    """A (2, 2) and B (2, 1) of d/dt (v_y, γ) = A (v_y, γ) + B δ at constant speed (eq. 11, corrected)."""
    p, v = model(vehicle), speed_mps
    cross = p.l_r * p.k_r - p.l_f * p.k_f
    A = np.array(
        [
            [-(p.k_f + p.k_r) / (p.m * v), cross / (p.m * v) - v],
            [cross / (p.I * v), -(p.l_f**2 * p.k_f + p.l_r**2 * p.k_r) / (p.I * v)],
        ]
    )
    B = np.array([[p.k_f / p.m], [p.l_f * p.k_f / p.I]])
    return A, B


def preview_model(vehicle: Vehicle, speed_mps: float, preview_m: float) -> tuple[FloatArray, FloatArray]:
    """A (4, 4), B (4, 2) for state (v_y, γ, y_L, e_L), input (δ_D, K_L) (eq. 21, corrected).

    y_L is the lateral offset of the road from the vehicle's axis at the preview distance D_L, e_L the road's
    heading relative to the vehicle there; both left positive.
    """
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[:2, :2], B[:2, :1] = single_track(vehicle, speed_mps)
    A[2] = [-1.0, -preview_m, 0.0, speed_mps]
    A[3] = [0.0, -1.0, 0.0, 0.0]
    B[3, 1] = speed_mps
    return A, B


def zero_order_hold(A: FloatArray, B: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Φ (n, n) and G (n, m) of x⁺ = Φ x + G u for an input held over the step."""
    n, m = B.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = A, B
    exponential = expm(block * step_s)
    return exponential[:n, :n], exponential[:n, n:]


def steady_state(vehicle: Vehicle, speed_mps: float, steer_rad: float) -> FloatArray:
    """(v_y, γ) in a steady turn, (2,)."""
    A, B = single_track(vehicle, speed_mps)
    return np.asarray(np.linalg.solve(A, -B[:, 0] * steer_rad))


@kernel
def derivatives(v_y, yaw_rate, steer, v, p):  # type: ignore[no-untyped-def]
    """(v̇_y, γ̇) of the corrected eq. (11); v in m/s above zero, p a Model."""
    front = p.k_f * (steer - (v_y + p.l_f * yaw_rate) / v)
    rear = p.k_r * (p.l_r * yaw_rate - v_y) / v
    return (front + rear) / p.m - v * yaw_rate, (p.l_f * front - p.l_r * rear) / p.I
