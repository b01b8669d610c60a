"""Whether the borders that a detector found lie on the true ones, row by row of the image."""

import math

import numpy as np

from camera_synth.camera import image_from_vehicle
from sumo_net.compile import kernel

ROWS = 50  # processed rows: y = 1, 4, 7, … 148, where the published search lays its blocks
ROW_STEP = 3
_NEAR_M = 1.0  # nearer points are behind the image plane or under the bonnet
_WIDTH = 320


@kernel
def _trace(ahead, i, slot, p, columns, slopes, kinds, stations):  # type: ignore[no-untyped-def]
    """Column, slope dx/dy, kind and station of border `slot` at the processed rows; NaN for none."""
    columns[:] = np.nan
    last_x, last_y = math.nan, math.nan
    for j in range(ahead.forward_m.shape[1]):
        offset = ahead.border_offset_m[i, j, slot]
        heading = ahead.heading_rad[i, j]
        forward = ahead.forward_m[i, j] - offset * math.sin(heading)
        left = ahead.left_m[i, j] + offset * math.cos(heading)
        x, y = math.nan, math.nan
        if forward - p.forward > _NEAR_M:
            x, y, _ = image_from_vehicle(forward, left, 0.0, p)
        if y > last_y:  # both are numbers, and the road goes on upwards in the image
            first = max(math.ceil((last_y - 1.0) / ROW_STEP), 0)
            for k in range(first, ROWS):
                row = 1.0 + ROW_STEP * k
                if row > y:
                    break
                part = (row - last_y) / (y - last_y)
                columns[k] = last_x + part * (x - last_x)
                slopes[k] = (x - last_x) / (y - last_y)
                kinds[k] = min(ahead.border_kind[i, j - 1, slot], ahead.border_kind[i, j, slot])
                stations[k] = ahead.station_m[i, j - 1] + part * (
                    ahead.station_m[i, j] - ahead.station_m[i, j - 1]
                )
        last_x, last_y = x, y


@kernel
def _boxes(objects, i, p, boxes):  # type: ignore[no-untyped-def]
    """Bounding rectangles (x0, x1, y0, y1) in the image of the bodies ahead; returns how many."""
    count = 0
    for m in range(objects.handle.shape[1]):
        if objects.handle[i, m] == -1 or objects.forward_m[i, m] < 2.0:
            continue
        cos, sin = math.cos(objects.heading_rad[i, m]), math.sin(objects.heading_rad[i, m])
        x0, x1, y0, y1 = 1e9, -1e9, 1e9, -1e9
        for corner in range(8):
            along = objects.length_m[i, m] * (0.5 if corner & 1 else -0.5)
            aside = objects.width_m[i, m] * (0.5 if corner & 2 else -0.5)
            up = objects.height_m[i, m] if corner & 4 else 0.0
            forward = objects.forward_m[i, m] + along * cos - aside * sin
            left = objects.left_m[i, m] + along * sin + aside * cos
            x, y, _ = image_from_vehicle(max(forward, p.forward + _NEAR_M), left, up, p)
            x0, x1, y0, y1 = min(x0, x), max(x1, x), min(y0, y), max(y1, y)
        boxes[count, 0], boxes[count, 1], boxes[count, 2], boxes[count, 3] = x0, x1, y0, y1
        count += 1
    return count


@kernel
def judge(ahead, objects, right_slot, other_slot, found, dash, tolerance_px, share, p, verdict):  # type: ignore[no-untyped-def]
    """verdict (n,) int8: 1 recognised, 0 not, -1 nothing to judge by.

    right_slot (n,): slot of the right border of the lane that contains the centre of gravity; other_slot
    (n,): that of a neighbouring lane that may be meant as well while the vehicle straddles a border, or -1.
    found (n, 2, ROWS): columns of the left and right border found, NaN for none.
    dash: (painted length, length of the whole pattern) of dashed markings in m.
    Recognised: both within tolerance_px / cosθ on at least `share` of the rows where the marking shows.
    """
    columns, slopes, stations = np.empty(ROWS), np.empty(ROWS), np.empty(ROWS)
    kinds = np.zeros(ROWS, np.int8)
    boxes = np.empty((objects.handle.shape[1], 4))
    for i in range(verdict.shape[0]):
        verdict[i] = -1
        hidden = _boxes(objects, i, p, boxes)
        for attempt in range(2):
            lane = right_slot[i] if attempt == 0 else other_slot[i]
            if lane < 0 or verdict[i] == 1:
                continue
            judged, good = 0, True
            for side in range(2):
                slot = lane + 1 - side  # the left border first
                if slot < 0 or slot >= ahead.border_offset_m.shape[2]:
                    continue
                _trace(ahead, i, slot, p, columns, slopes, kinds, stations)
                shown, hit = 0, 0
                for k in range(ROWS):
                    x = columns[k]
                    if not (1.0 <= x <= _WIDTH - 2.0) or kinds[k] == 0:
                        continue
                    if kinds[k] == 2 and stations[k] - dash[1] * math.floor(stations[k] / dash[1]) > dash[0]:
                        continue
                    y = 1.0 + ROW_STEP * k
                    free = True
                    for b in range(hidden):
                        if boxes[b, 0] <= x <= boxes[b, 1] and boxes[b, 2] <= y <= boxes[b, 3]:
                            free = False
                            break
                    if not free:
                        continue
                    shown += 1
                    if abs(found[i, side, k] - x) <= tolerance_px * math.sqrt(1.0 + slopes[k] ** 2):
                        hit += 1
                if shown >= 3:
                    judged += 1
                    good = good and hit >= share * shown
            if judged > 0:
                verdict[i] = 1 if good else max(verdict[i], 0)
