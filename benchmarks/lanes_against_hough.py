"""Lane detection compared with an OpenCV pipeline of Canny and HoughLinesP, on the same rendered frames.

    python benchmarks/lanes_against_hough.py [--duration 10] [--out out/bench/lanes.json]

Equipped vehicles drive through traffic on the scenarios `straight` and `highway`, clear and complex. Each
frame is processed by the published search, by the refined chain (both keep state between frames) and by the
OpenCV pipeline, with the same criterion: both borders within 5 px / cos θ on 85 % of the rows where the
marking is visible. Measured is processor time per frame on one thread, without SUMO and rendering. The
pipeline: blur, Canny, probabilistic Hough below the horizon, segments assigned to borders by slope and foot,
a straight line through each border weighted by length, the last frame's border if none is found. Its
parameters were set once and not tuned.
"""

import argparse
import multiprocessing
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from side_by_side import report

HORIZON_ROW = 239 - 157  # array row
CANNY, VOTES, LEAST_PX, GAP_PX = (40, 120), 15, 15, 8
CASES = [(scenario, condition) for scenario in ("straight", "highway") for condition in ("clear", "complex")]


class Hough:
    """The OpenCV pipeline for one vehicle; `borders` gives x = b·y + c (y up) for left and right."""

    def __init__(self) -> None:
        self._last = np.full((2, 2), np.nan)

    def borders(self, frame: np.ndarray) -> np.ndarray:
        """(2, 2) b and c; NaN for a border never seen."""
        top = HORIZON_ROW + 12
        edges = cv2.Canny(cv2.GaussianBlur(frame[top:], (5, 5), 0), *CANNY)
        lines = cv2.HoughLinesP(edges, 1, np.pi / 180, VOTES, minLineLength=LEAST_PX, maxLineGap=GAP_PX)
        if lines is None:
            return self._last
        x0, y0, x1, y1 = lines.reshape(-1, 4).T.astype(float)
        y0, y1 = 239.0 - (y0 + top), 239.0 - (y1 + top)
        steep = np.abs(y1 - y0) > 5.0
        with np.errstate(divide="ignore", invalid="ignore"):
            b = np.where(steep, (x1 - x0) / (y1 - y0), np.nan)
        c = x0 - b * y0
        length = np.hypot(x1 - x0, y1 - y0)
        for side, (sign, low, high) in enumerate(((1.0, -150.0, 130.0), (-1.0, 190.0, 470.0))):
            of_side = steep & (sign * b > 0.3) & (sign * b < 2.6) & (c > low) & (c < high)
            if not of_side.any():
                continue
            # the border next to the vehicle: segments near the innermost one with support
            foot, weight = c[of_side], length[of_side]
            inner = foot.max() if side == 0 else foot.min()
            near = np.abs(foot - inner) < 45.0
            self._last[side] = (
                np.average(b[of_side][near], weights=weight[near]),
                np.average(foot[near], weights=weight[near]),
            )
        return self._last


def drive(scenario: str, condition: str, duration_s: float, seed: int) -> dict[str, Any]:
    """Verdicts and seconds of all three on the frames of one run."""
    from analysis.simulate import simulate
    from plugin import vision
    from plugin.lane import detector, genetic, refine
    from plugin.lane.estimate import BORDER_Y

    pipelines: dict[int, Hough] = {}
    seconds = {"refined": 0.0, "paper": 0.0, "hough": 0.0}
    verdicts: list[np.ndarray] = []
    look, search, step = vision.Vision._look, genetic.search, refine.step
    inside = {"search": "paper"}

    def timed(function: Any, name: str) -> Any:
        def run(*arguments: Any) -> Any:
            begin = time.process_time()
            result = function(*arguments)
            seconds[name if name != "search" else inside["search"]] += time.process_time() - begin
            return result

        return run

    start = detector.LaneTracker._search

    def starting(self: Any, *arguments: Any) -> Any:
        inside["search"] = "refined"  # a search that starts the refined chain counts as its cost
        try:
            return start(self, *arguments)
        finally:
            inside["search"] = "paper"

    def looking(self: Any, frames: np.ndarray, state: Any, scene: Any, *rest: Any) -> Any:
        after, sight = look(self, frames, state, scene, *rest)
        begin = time.process_time()
        lines = np.array(
            [
                pipelines.setdefault(int(key), Hough()).borders(frame)
                for key, frame in zip(state.camera_key, frames, strict=True)
            ]
        )
        seconds["hough"] += time.process_time() - begin
        columns = lines[:, :, :1] * BORDER_Y + lines[:, :, 1:]
        verdict = self._judge(scene, state.looks, np.ascontiguousarray(columns), rest[-1])
        verdicts.append(np.stack([sight.recognised, sight.beside_recognised, verdict]))
        return after, sight

    vision.Vision._look = looking  # type: ignore[method-assign]
    detector.LaneTracker._search = starting  # type: ignore[method-assign]
    genetic.search, refine.step = timed(search, "search"), timed(step, "refined")
    with tempfile.TemporaryDirectory() as out:
        simulate(
            scenario,
            Path(out),
            seed=seed,
            duration_s=duration_s,
            fraction=0.1,
            condition=condition,
            formats=("parquet",),
            compare_paper=True,
            threads=1,
            quiet=True,
        )
    return {"verdicts": np.concatenate(verdicts, axis=1), "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--duration", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=500)
    parser.add_argument("--out", type=Path, default=Path("out/bench/lanes.json"))
    options = parser.parse_args()
    cv2.setNumThreads(1)
    rows = []
    context = multiprocessing.get_context("spawn")  # one SUMO per process
    for scenario, condition in CASES:
        with ProcessPoolExecutor(1, context, initializer=cv2.setNumThreads, initargs=(1,)) as pool:
            drive_arguments = (scenario, condition, options.duration, options.seed)
            result = pool.submit(drive, *drive_arguments).result()
        verdicts, seconds = result["verdicts"], result["seconds"]
        for k, (name, title) in enumerate(
            (("refined", "refined chain"), ("paper", "published search"), ("hough", "OpenCV Canny + Hough"))
        ):
            judged = verdicts[k] >= 0
            frames = verdicts.shape[1]
            rows.append(
                {
                    "scenario": scenario,
                    "condition": condition,
                    "detection": title,
                    "recognised, %": 100.0 * float(np.mean(verdicts[k][judged] == 1)),
                    "ms a frame": 1e3 * seconds[name] / frames,
                    "times refined": seconds[name] / seconds["refined"],
                    "frames": float(frames),
                }
            )
    note = "both borders right on the same frames; SUMO, rendering and judging are not in the times"
    report("Lane detection", rows, options.out, ("opencv-python-headless", "numba"), note)


if __name__ == "__main__":
    main()
