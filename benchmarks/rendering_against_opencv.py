"""The road camera compared with OpenCV drawing the same scene, by polygons and by warping a bird's-eye view.

    python benchmarks/rendering_against_opencv.py [--roads 16] [--out out/bench/rendering.json]

Straights and bends with solid and dashed lines, in flat greys with sensor noise: asphalt, verge, sky, paint.
`polygons` projects the outlines with cv2.projectPoints and fills them with anti-aliased cv2.fillPoly; `warp`
draws a map of the road from above (5 x 20 cm) and maps it into the image with cv2.warpPerspective. Noise is
from cv2.randn. Measured is processor time per frame of the 150 rows that lane detection reads. Accuracy: the
centroid of the solid lines in every row, without noise, compared with the true line (camera_synth.truth), and
this renderer compared with the polygons, which are independent of its geometry. The full preset `clear`
(texture, wheel tracks, haze, vignetting, drifting exposure), which OpenCV does not draw here, is also timed.
"""

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from side_by_side import cpu_seconds, report

from camera_synth.camera import HEIGHT_PX, PROCESSED_FROM, WIDTH_PX, Camera, projection
from camera_synth.condition import Condition, looks, preset
from camera_synth.pose import Pose
from camera_synth.render import new_frames, render
from camera_synth.truth import border_columns
from sumo_net.plain_road import no_objects, road_ahead
from sumo_net.randomness import stream_key
from sumo_net.road import DASHED, OWN_RIGHT, SOLID, RoadAhead
from sumo_net.road_table import AHEAD_M

CAMERA, NOISE_GREY, REPEATS = Camera(), 3.0, 7
KINDS = (SOLID, SOLID, SOLID, DASHED)  # right edge, own lane's two borders, one more lane to the left
FLAT = {"texture": 0.0, "wheel_tracks": 0.0, "drift": 0.0, "vignetting": 0.0, "visibility_m": 1e9}
SHIFT = 4  # fillPoly's fixed-point bits
CELL_M = (0.05, 0.20)  # bird's-eye map: across, along
REACH_M, HALF_WIDTH_M = (6.0, 120.0), 14.0


def roads(count: int) -> RoadAhead:
    """Bends from R -500 to 500 m, with vehicles at different positions in their lane."""
    curvature = np.linspace(-2e-3, 2e-3, count)
    offset = 0.4 * np.sin(2.0 * np.arange(count))
    return road_ahead(curvature, 0.0, offset, 0.01 * np.cos(np.arange(count)), 1000.0, kinds=KINDS)


def ours(road: RoadAhead, condition: Condition, first_row: int = PROCESSED_FROM) -> np.ndarray:
    """Frames of this project's renderer."""
    n = len(road.forward_m)
    frames = new_frames(n)
    keys = np.array([stream_key(3, f"car{i}", "camera") for i in range(n)], np.uint64)
    pose = Pose(*np.zeros((3, n)))
    counter = np.zeros(n, np.int64)
    render(
        frames, projection(CAMERA), road, no_objects(n), pose, looks(condition, n), keys, counter, first_row
    )
    return frames


class OpenCv:
    """The same scene with OpenCV; the camera as a matrix and a rotation."""

    def __init__(self, condition: Condition) -> None:
        self.c = condition
        f, pitch = CAMERA.focal_px, CAMERA.pitch_rad
        # array coordinates: y down from the top row
        self.matrix = np.array(
            [[f, 0.0, CAMERA.center_x_px], [0.0, f, HEIGHT_PX - 1 - CAMERA.center_y_px], [0.0, 0.0, 1.0]]
        )
        # camera axes (right, down, ahead) from the vehicle's (forward, left, up)
        level = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
        cos, sin = np.cos(pitch), np.sin(pitch)
        tilt = np.array([[1.0, 0.0, 0.0], [0.0, cos, -sin], [0.0, sin, cos]])
        self.rotation = tilt @ level
        self.turn, _ = cv2.Rodrigues(self.rotation)
        self.move = -self.rotation @ np.array([CAMERA.forward_m, CAMERA.left_m, CAMERA.height_m])
        ground = np.column_stack([self.rotation[:, :2], self.move])  # homography from (forward, left, 1)
        across, along = CELL_M
        cells = np.array([[0.0, -along, REACH_M[1]], [-across, 0.0, HALF_WIDTH_M], [0.0, 0.0, 1.0]])
        self.warp = self.matrix @ ground @ cells  # from the map's (column, row)
        self.map_shape = (round((REACH_M[1] - REACH_M[0]) / along), round(2 * HALF_WIDTH_M / across))
        horizon = HEIGHT_PX - 1 - CAMERA.horizon_y_px
        self.below = (np.arange(HEIGHT_PX) > horizon)[PROCESSED_FROM:]
        self.noise = np.empty((HEIGHT_PX - PROCESSED_FROM, WIDTH_PX), np.int16)

    def outlines(self, road: RoadAhead, i: int) -> list[tuple[np.ndarray, float]]:
        """(points (m, 2) forward and left, grey): asphalt first, then lines and dashes."""
        s = AHEAD_M
        near = s >= 4.0
        along = np.column_stack([road.forward_m[i], road.left_m[i]])
        normal = np.column_stack([-np.sin(road.heading_rad[i]), np.cos(road.heading_rad[i])])

        def strip(right: Any, left: Any, inside: np.ndarray) -> np.ndarray:
            a = (along + normal * np.asarray(right)[..., None])[inside]
            b = (along + normal * np.asarray(left)[..., None])[inside]
            return np.concatenate([a, b[::-1]])

        out = [(strip(road.road_right_m[i], road.road_left_m[i], near), self.c.asphalt_grey)]
        first = OWN_RIGHT - 1
        for k, kind in enumerate(KINDS):
            d = road.border_offset_m[i, :, first + k]
            outermost = k in (0, len(KINDS) - 1)
            half = 0.5 * (self.c.edge_width_m if outermost else self.c.marking_width_m)
            if kind == SOLID:
                out.append((strip(d - half, d + half, near), self.c.paint_grey))
                continue
            period = self.c.dash_stroke_m + self.c.dash_gap_m
            start = road.station_m[i, 0] - s[0]
            for begin in (
                np.arange(np.ceil((start - 20.0) / period), (start + 180.0) / period) * period - start
            ):
                at = np.linspace(begin, begin + self.c.dash_stroke_m, 5)
                at = at[(at >= 4.0) & (at <= 170.0)]
                if len(at) > 1:
                    x, y = (np.interp(at, s, along[:, j]) for j in range(2))
                    nx, ny = (np.interp(at, s, normal[:, j]) for j in range(2))
                    dd = np.interp(at, s, d)
                    a = np.column_stack([x + nx * (dd - half), y + ny * (dd - half)])
                    b = np.column_stack([x + nx * (dd + half), y + ny * (dd + half)])
                    out.append((np.concatenate([a, b[::-1]]), self.c.paint_grey))
        return out

    def polygons(self, road: RoadAhead, i: int, noisy: bool) -> np.ndarray:
        """One frame by projected outlines."""
        frame = np.full((HEIGHT_PX - PROCESSED_FROM, WIDTH_PX), self.c.sky_grey, np.uint8)
        frame[self.below] = self.c.verge_grey
        for points, grey in self.outlines(road, i):
            seen = points[points[:, 0] > 4.0]
            if len(seen) < 3:
                continue
            in_space = np.column_stack([seen, np.zeros(len(seen))])
            image, _ = cv2.projectPoints(in_space, self.turn, self.move, self.matrix, None)
            image = image[:, 0] - [0.0, PROCESSED_FROM]
            fixed = np.rint(np.clip(image, -4000, 4000) * (1 << SHIFT)).astype(np.int32)
            cv2.fillPoly(frame, [fixed], float(grey), cv2.LINE_AA, SHIFT)
        return self.noised(frame, noisy)

    def warped(self, road: RoadAhead, i: int, noisy: bool) -> np.ndarray:
        """One frame by a map from above."""
        above = np.full(self.map_shape, self.c.verge_grey, np.uint8)
        for points, grey in self.outlines(road, i):
            cell = np.column_stack(
                [(HALF_WIDTH_M - points[:, 1]) / CELL_M[0], (REACH_M[1] - points[:, 0]) / CELL_M[1]]
            )
            fixed = np.rint(cell * (1 << SHIFT)).astype(np.int32)
            cv2.fillPoly(above, [fixed], float(grey), cv2.LINE_AA, SHIFT)
        lift = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -PROCESSED_FROM], [0.0, 0.0, 1.0]])
        frame = np.full((HEIGHT_PX - PROCESSED_FROM, WIDTH_PX), self.c.sky_grey, np.uint8)
        frame[self.below] = self.c.verge_grey
        size = (WIDTH_PX, HEIGHT_PX - PROCESSED_FROM)
        cv2.warpPerspective(above, lift @ self.warp, size, frame, cv2.INTER_LINEAR, cv2.BORDER_TRANSPARENT)
        return self.noised(frame, noisy)

    def noised(self, frame: np.ndarray, noisy: bool) -> np.ndarray:
        """The frame with sensor noise of NOISE_GREY, if `noisy`."""
        if not noisy:
            return frame
        cv2.randn(self.noise, 0, NOISE_GREY)
        return cv2.add(frame, self.noise, dtype=cv2.CV_8U)


def centroids(frames: np.ndarray, column: np.ndarray, condition: Condition) -> np.ndarray:
    """(n, 2, 150) columns of the lines next to the vehicle: centroid of pixels brighter than asphalt."""
    found = np.full(column.shape, np.nan)
    horizon = CAMERA.horizon_y_px
    for i, side, y in np.ndindex(*column.shape):
        x = column[i, side, y]
        half = 0.5 * condition.marking_width_m * (horizon - y) / CAMERA.height_m + 4.0
        slope = abs(np.gradient(column[i, side])[y]) if np.isfinite(column[i, side]).all() else 1.0
        half += slope
        if not np.isfinite(x) or x - half < 1 or x + half > 318 or horizon - y < 22:
            continue
        at = np.arange(int(np.ceil(x - half)), int(x + half) + 1)
        weight = np.clip(frames[i, HEIGHT_PX - 1 - PROCESSED_FROM - y, at].astype(float), None, 255)
        weight = np.clip(weight - condition.asphalt_grey, 0.0, None)
        if weight.sum() > 50.0:
            found[i, side, y] = np.average(at, weights=weight)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--roads", type=int, default=16)
    parser.add_argument("--out", type=Path, default=Path("out/bench/rendering.json"))
    parser.add_argument("--picture", type=Path, help="write the three renderings of road 0 side by side")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    road, n = roads(options.roads), options.roads
    still = preset("clear", **FLAT, noise_grey=0.0)
    noisy = preset("clear", **FLAT, noise_grey=NOISE_GREY)
    other = OpenCv(noisy)
    pose = Pose(*np.zeros((3, n)))
    own = np.full(n, OWN_RIGHT)
    truth = border_columns(projection(CAMERA), road, no_objects(n), own, looks(still, n), pose)
    drawn = {
        "this project": ours(road, still)[:, PROCESSED_FROM:],
        "OpenCV, polygons": np.stack([other.polygons(road, i, False) for i in range(n)]),
        "OpenCV, warp": np.stack([other.warped(road, i, False) for i in range(n)]),
    }
    lines = {name: centroids(frames, truth.column, still) for name, frames in drawn.items()}
    seconds = {
        "this project": cpu_seconds(lambda: ours(road, noisy), REPEATS)[0],
        "OpenCV, polygons": cpu_seconds(lambda: [other.polygons(road, i, True) for i in range(n)], REPEATS)[
            0
        ],
        "OpenCV, warp": cpu_seconds(lambda: [other.warped(road, i, True) for i in range(n)], REPEATS)[0],
        "this project, day `clear`": cpu_seconds(lambda: ours(road, preset("clear")), REPEATS)[0],
    }
    outlines = cpu_seconds(lambda: [other.outlines(road, i) for i in range(n)], REPEATS)[0]
    rows = []
    for name, spent in seconds.items():
        off = lines.get(name, np.full_like(truth.column, np.nan))
        error, between = (np.abs(off - known) for known in (truth.column, lines["this project"]))
        known = np.isfinite(error)
        rows.append(
            {
                "renderer": name,
                "ms a frame": 1e3 * spent / n,
                "of it outlines": 1e3 * outlines / n if name.startswith("OpenCV") else 0.0,
                "times ours": spent / seconds["this project"],
                "px from truth, median": float(np.median(error[known])) if known.any() else np.nan,
                "95 %": float(np.quantile(error[known], 0.95)) if known.any() else np.nan,
                "px from ours, 95 %": float(np.nanquantile(between, 0.95)) if known.any() else np.nan,
                "rows": float(known.sum()),
            }
        )
    if options.picture:
        options.picture.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(options.picture), np.hstack([frames[0] for frames in drawn.values()]))
    note = (
        f"{n} roads, 150 rows, one thread; solid borders of the own lane, rows to 22 px below the horizon. "
        "Outlines: numpy's building of the polygons, part of the OpenCV ways' time"
    )
    report("Rendering", rows, options.out, ("opencv-python-headless", "numba"), note)


if __name__ == "__main__":
    main()
