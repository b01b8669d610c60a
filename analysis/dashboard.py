"""The driver's display and its inputs: speed, time to lane crossing, lamps."""

import numpy as np
import pandas as pd

from analysis import canvas
from sumo_net.arrays import Array

TLC_SPAN_S = 3.0
_OFF = (84, 80, 76)
_RED, _AMBER = (60, 60, 235), (0, 170, 255)


def draw_dashboard(picture: Array, step: "pd.Series[float]") -> None:
    """Fill `picture` (a BGR view, about 96 high) with the figures of a row of `steps`."""
    picture[:] = canvas.DARK
    height, width = picture.shape[:2]
    upper, lower = height * 0.32, height * 0.74
    canvas.text(picture, f"{3.6 * step['speed_mps']:.0f}", 98, height * 0.46, 44, anchor="right", bold=True)
    canvas.text(picture, "km/h", 104, height * 0.56, 15, canvas.GREY)
    _tlc(picture, step, 160, upper, lower, (width - 170) * 0.36)
    left = 160 + (width - 170) * 0.36 + 46
    _departure(picture, step, left, upper)
    _collision(picture, step, left, lower)


def _tlc(
    picture: Array, step: "pd.Series[float]", left: float, upper: float, lower: float, width: float
) -> None:
    value, side = step["tlc_s"], step["tlc_side"]
    locked = bool(step["lane_locked"]) and str(step["ldw_state"]) != "lane not seen"
    if not locked:
        words = "lane not seen"
    elif pd.isna(value):
        words = f"no crossing within {TLC_SPAN_S:.0f} s"
    else:
        words = f"crossing {side} in {value:.1f} s"
    canvas.text(picture, words, left, upper - 6, 17, bold=locked and pd.notna(value))
    begin, end = round(left), round(left + width)
    top, bottom = round(lower - 17), round(lower + 3)
    picture[top:bottom, begin:end] = _OFF
    if locked:
        # full while the border is far; shrinks as the crossing approaches
        share = 1.0 if pd.isna(value) else min(float(value) / TLC_SPAN_S, 1.0)
        colour = _RED if share < 0.34 else _AMBER if share < 0.67 else canvas.GREEN
        picture[top:bottom, begin : begin + round(share * width)] = colour
    true = step["true_tlc_s"]
    if pd.notna(true) and true <= TLC_SPAN_S:
        at = round(left + float(true) / TLC_SPAN_S * width)
        picture[top - 4 : bottom + 4, max(at - 1, begin) : at + 2] = canvas.WHITE
        canvas.text(picture, "truth", at, bottom + 10, 11, anchor="centre")
    for second in range(int(TLC_SPAN_S) + 1):
        canvas.text(
            picture, f"{second}", left + second / TLC_SPAN_S * width, top - 9, 11, canvas.GREY, "centre"
        )
    canvas.text(picture, "s", end + 10, lower - 7, 12, canvas.GREY)


def _departure(picture: Array, step: "pd.Series[float]", left: float, row: float) -> None:
    state = str(step["ldw_state"])
    for side, sign, at in (("left", -1, left + 12), ("right", 1, left + 46)):
        on = state == f"warning {side}"
        tip = [[at + sign * 13, row], [at - sign * 9, row - 13], [at - sign * 9, row + 13]]
        canvas.area(picture, np.array(tip), _RED if on else _OFF)
    active = state.startswith("warning")
    canvas.text(picture, "LDW", left + 72, row, 13, canvas.GREY)
    canvas.text(picture, state, left + 110, row, 17, _RED if active else canvas.WHITE, bold=active)


def _collision(picture: Array, step: "pd.Series[float]", left: float, row: float) -> None:
    state = str(step["fcw_state"])
    for name, colour, at in (("reminder", _AMBER, left + 12), ("danger", _RED, left + 46)):
        canvas.dot(picture, at, row, 13, colour if bool(step[f"fcw_lamp_{name}"]) else _OFF)
    active = state in ("reminder", "danger")
    canvas.text(picture, "FCW", left + 72, row, 13, canvas.GREY)
    words = state
    if pd.notna(step["fcw_gap_m"]):
        words += f", gap {step['fcw_gap_m']:.0f} m"
    if pd.notna(step["fcw_ttc_s"]) and step["fcw_ttc_s"] < 10.0:
        words += f", TTC {step['fcw_ttc_s']:.1f} s"
    colour = (_RED if state == "danger" else _AMBER) if active else canvas.WHITE
    canvas.text(picture, words, left + 110, row, 15 if active else 17, colour, bold=active)
