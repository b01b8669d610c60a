"""Differences of a run on another processor: one scenario with this machine's and with basic arithmetic.

    python benchmarks/machines.py [--scenario curves] [--duration 30] [--seeds 5] [--equip 0.1]

The other machine is this one with every library restricted to the instructions of all 64-bit x86 processors:
no fused multiply-adds, no AVX, in numba's kernels, numpy, BLAS, OpenCV and glibc's mathematical functions.
SUMO is the same program in both, but depends on the lateral positions written to it.

Printed: for columns of `steps` the largest difference between the machines in the first 1 s, 5 s and overall;
for figures of the summary both machines' means over the seeds, and for comparison with their difference the
standard deviation over the seeds.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd

PLAIN = {
    "NUMBA_CPU_NAME": "x86-64",
    "NUMBA_CPU_FEATURES": "",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3 X86_V4 AVX512_ICL AVX512_SPR",
    "OPENBLAS_CORETYPE": "Prescott",
    "OPENCV_CPU_DISABLE": "AVX,AVX2,FMA3,AVX512F,AVX512-SKX",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
}
_RUN = "import sys; from benchmarks.machines import run; run(*sys.argv[1:])"
COLUMNS = ("true_x_m", "true_lateral_offset_m", "lateral_offset_m", "heading_error_rad", "tlc_s")
FIGURES = (
    "recognition_rate", "lateral_offset_rmse_m", "heading_rmse_rad", "curvature_rmse_1pm", "warnings",
    "departures", "distance_km",
)  # fmt: skip


def run(out: str, scenario: str, duration_s: str, equip: str, seeds: str) -> None:
    """Run all seeds of one machine, each into a folder of `out`."""
    from analysis.simulate import simulate

    for seed in range(1, int(seeds) + 1):
        simulate(
            scenario,
            Path(out) / str(seed),
            seed=seed,
            duration_s=float(duration_s),
            fraction=float(equip),
            threads=1,
            quiet=True,
        )


def differences(here: pd.DataFrame, there: pd.DataFrame) -> pd.DataFrame:
    """Largest difference of COLUMNS by the time since the beginning, and the share of rows that are equal."""
    keys = ["time_s", "vehicle_id"]
    both = here.merge(there, on=keys, suffixes=("", "_there"), validate="one_to_one")
    since = both["time_s"] - both["time_s"].min()
    found = {}
    for name in COLUMNS:
        apart = (both[name] - both[f"{name}_there"]).abs()
        one_sided = both[name].isna() != both[f"{name}_there"].isna()
        found[name] = {
            "1 s": apart[since < 1.0].max(),
            "5 s": apart[since < 5.0].max(),
            "all": apart.max(),
            "equal_%": 100.0 * float(((apart == 0.0) | (apart.isna() & ~one_sided)).mean()),
            "known in one": int(one_sided.sum()),
        }
    return pd.DataFrame(found).T


def main() -> None:
    """Run on both, print the tables."""
    from analysis.metrics import summary
    from plugin.record import read_table

    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenario", default="curves")
    parser.add_argument("--duration", type=float, default=30.0)
    parser.add_argument("--equip", type=float, default=0.1)
    parser.add_argument("--seeds", type=int, default=5)
    given = parser.parse_args()
    words = [given.scenario, str(given.duration), str(given.equip), str(given.seeds)]
    machines: dict[str, dict[str, str]] = {"this": {}, "plain": PLAIN}
    with tempfile.TemporaryDirectory() as work:
        figures: dict[str, list[dict[str, float]]] = {}
        steps: dict[str, list[pd.DataFrame]] = {}
        for name, limits in machines.items():
            out = Path(work) / name
            subprocess.run(
                [sys.executable, "-c", _RUN, str(out), *words], env={**os.environ, **limits}, check=True
            )
            folders = [out / str(seed) for seed in range(1, given.seeds + 1)]
            steps[name] = [read_table(folder, "steps") for folder in folders]
            tables = ("steps", "predictions", "warnings", "departures", "tracks", "conflicts")
            figures[name] = [summary(*(read_table(folder, table) for table in tables)) for folder in folders]
    apart = [differences(*pair) for pair in zip(steps["this"], steps["plain"], strict=True)]
    print(pd.concat(apart).groupby(level=0).max().to_string(float_format="{:.3g}".format))
    here, there = (pd.DataFrame(figures[name])[list(FIGURES)] for name in machines)
    table = pd.DataFrame(
        {"this": here.mean(), "plain": there.mean(), "most apart": (here - there).abs().max()}
    )
    print(table.assign(sd_of_seeds=here.std(), most_relative=((here - there).abs() / here).max()).to_string())


if __name__ == "__main__":
    main()
