"""A short run, and where its compiled kernels come from: `python kernels.py FOLDER`, FOLDER the user's cache.

To be started twice where the installed packages cannot be written: what the first process compiles into the
user's cache folder, the second one takes from there.
"""

import sys
import tempfile
import time
from pathlib import Path

from analysis.simulate import simulate
from sumo_net.compile import KERNELS


def main(folder: Path) -> None:
    """Exit status 1 where a kernel's cache is elsewhere. Prints how many were compiled and loaded."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as out:
        simulate("straight", Path(out), duration_s=3.0, threads=1, quiet=True)
    used = [one.stats for one in KERNELS if one.signatures]
    elsewhere = sorted({str(one.cache_path) for one in used if folder not in Path(one.cache_path).parents})
    if elsewhere or not used:
        sys.exit(f"kernels are kept elsewhere than in {folder}: {elsewhere or 'there are none'}")
    compiled = sum(sum(one.cache_misses.values()) for one in used)
    loaded = sum(sum(one.cache_hits.values()) for one in used)
    print(f"kernels: {compiled} compiled, {loaded} loaded, {time.process_time() - began:.0f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
