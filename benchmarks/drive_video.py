"""Cost of frames, replays and videos of a drive: processor time per second driven.

    python benchmarks/drive_video.py [--duration 60] [--out out/drive_video]

Processor time, not wall-clock time, so that other load does not matter. Below 2, a machine with two cores is
faster than real time.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path

from analysis.drive import load_drive, most_interesting
from analysis.replay import replay
from analysis.simulate import simulate
from analysis.video import make_video


def processor_s(work: Callable[[], object]) -> float:
    """Processor time of all threads of this process."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def main() -> None:
    """Print one line per measurement."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--out", type=Path, default=Path("out/drive_video"))
    given = parser.parse_args()

    def run(name: str, seconds: float, frames: int) -> Path:
        return simulate("highway", given.out / name, seed=1, duration_s=seconds, frames=frames, quiet=True)

    run("warm", 2.0, 1)  # kernels are loaded
    plain = processor_s(lambda: run("plain", given.duration, 0))
    print(f"{'run':28} {plain / given.duration:6.2f} core-seconds per second simulated")
    kept = 10
    watched = processor_s(lambda: run("watched", given.duration, kept))
    files = list((given.out / "watched" / "frames").glob("*/*"))
    frames = sum(file.suffix == ".png" for file in files)
    print(f"{'keeping a frame':28} {1e3 * (watched - plain) / frames:6.1f} ms ({frames} of {kept} vehicles)")
    print(
        f"{'a frame with its marks':28} {sum(file.stat().st_size for file in files) / frames / 1e3:6.1f} kB"
    )

    directory = given.out / "plain"
    name = most_interesting(directory)
    again = processor_s(lambda: replay(directory, [name]))
    driven = len(load_drive(directory, name).time_s) / 10.0
    print(f"{'frames made afterwards':28} {again / driven:6.2f} core-seconds per second of {driven:.0f} s")
    for suffix in ("mp4", "webm"):
        out = given.out / f"drive.{suffix}"
        cost = processor_s(lambda out=out: make_video(directory, out, name))  # type: ignore[misc]
        size = out.stat().st_size / 1e6
        print(f"{'video, ' + suffix:28} {cost / driven:6.2f} core-seconds per second, {size:.1f} MB")


if __name__ == "__main__":
    main()
