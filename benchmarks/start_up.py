"""Start-up to the end of the first step, with compiled kernels and with an empty cache."""

import os
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

ONE_STEP = """
import sys
from pathlib import Path
from analysis.simulate import simulate
simulate("highway", Path(sys.argv[1]), seed=1, duration_s=0.1, fraction=0.2, quiet=True)
"""


def start_up(cold: bool) -> dict[str, Any]:
    """Wall-clock and processor time in s from the command to the end of the first step."""
    with tempfile.TemporaryDirectory() as scratch:
        environment = dict(os.environ)
        if cold:
            environment["NUMBA_CACHE_DIR"] = f"{scratch}/cache"
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        command = [sys.executable, "-c", ONE_STEP, f"{scratch}/out"]
        subprocess.run(command, check=True, env=environment, stdout=subprocess.DEVNULL)
        wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall, "processor_s": processor, "load_average": os.getloadavg()[0]}
