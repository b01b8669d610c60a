"""Scalar kernels of the front-wheel angle from the camera alone (Zhang et al. 2011, section 2).

The road's heading relative to the vehicle at the preview point changes by ė_L = v K_L − γ. With the road's
curvature subtracted, it gives the yaw rate and, by geometry, the steer of a car without slip (eq. 10); f
corrects it to the steer that the car with slip needs for the same radius (eq. 13).
"""

from sumo_net.compile import kernel


@kernel
def kinematic_steer(curvature, heading, heading_before, v, wheelbase, step):  # type: ignore[no-untyped-def]
    """δ_k = L K_L − L (e_L,k − e_L,k−1) / (v T) (eq. 10), rad; v above zero."""
    return wheelbase * (curvature - (heading - heading_before) / (v * step))


@kernel
def correction(v, understeer, wheelbase):  # type: ignore[no-untyped-def]
    """f = δ_D / δ_k = 1 + K_u v² / L (eq. 13, whose print misplaces the fraction)."""
    return 1.0 + understeer * v * v / wheelbase


@kernel
def handover(v, low, high):  # type: ignore[no-untyped-def]
    """Weight of the dynamic steer: 0 up to `low`, 1 from `high` m/s on, smooth between."""
    w = min(1.0, max(0.0, (v - low) / (high - low)))
    return w * w * (3.0 - 2.0 * w)


@kernel
def front_steer(  # type: ignore[no-untyped-def]
    curvature, heading, heading_before, v, understeer, wheelbase, step, low, high
):
    """δ_D in rad from two successive looks (eqs. 10, 13), blended into L K_L between `high` and `low` m/s."""
    w = handover(v, low, high)
    steer = wheelbase * curvature
    if w > 0.0:
        kinematic = kinematic_steer(curvature, heading, heading_before, v, wheelbase, step)
        steer += w * (kinematic * correction(v, understeer, wheelbase) - steer)
    return steer
