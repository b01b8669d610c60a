"""Size of a run's report page, time to open it in a browser, and response time of its slider.

    python benchmarks/report_page.py --out out/report_page            # 120 s, at least 20 equipped vehicles
    python benchmarks/report_page.py --run out/demo --out out/report_page

Each time the page is opened in a new Chromium, started and warmed up with an empty page. `load` is the
browser's load event (all but map and timeline is drawn and responsive), `plots` when these two are drawn too;
both are wall-clock times, which other load lengthens, so the browser's processor time is given as well.
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import psutil

sys.path.insert(0, str(Path(__file__).parents[1]))

from analysis.report import write_report
from analysis.simulate import simulate
from plugin.record import read_table
from tests.analysis import chromium

WANTED = {"size_mb": 15.0, "load_ms": 2000.0, "plots_ms": 2000.0, "slider_ms": 100.0}


def measure(page: Path) -> dict[str, Any]:
    """Open the page once in a new browser."""
    with tempfile.TemporaryDirectory(prefix="sumo-adas-") as work, chromium.browser(Path(work)) as driver:
        empty = Path(work) / "empty.html"
        empty.write_text("<!DOCTYPE html><title>empty</title><p>warmed up", encoding="utf-8")
        driver.get(empty.as_uri())
        time.sleep(1.0)
        before = _cpu_s(driver)
        chromium.open_page(driver, page)
        load, plots = driver.execute_script(
            "return [performance.getEntriesByType('navigation')[0].loadEventEnd,"
            " performance.getEntriesByName('plots')[0]?.startTime ?? null]"
        )
        cpu = _cpu_s(driver) - before
        waits = driver.execute_async_script(
            """
            const done = arguments[0], slider = document.getElementById('slider'), waits = [];
            if (!slider) { done([]); return; }
            const last = Number(slider.max);
            const next = (k) => {
                if (k === 40) { done(waits); return; }
                const index = Math.round(((k * 17) % 40) / 39 * last), begin = performance.now();
                slider.value = index;
                delete slider.dataset.drawn;
                slider.dispatchEvent(new Event('input'));
                const wait = () => slider.dataset.drawn === String(index)
                    ? requestAnimationFrame(() => { waits.push(performance.now() - begin); next(k + 1); })
                    : setTimeout(wait, 1);
                wait();
            };
            next(0);
            """
        )
        return {
            "load_ms": load,
            "plots_ms": plots,
            "cpu_s": cpu,
            "slider_ms": waits,
            "console": chromium.complaints(driver),
        }


def _cpu_s(driver: Any) -> float:
    """Processor time so far of all browser processes."""
    root = psutil.Process(driver.service.process.pid)
    return sum(sum(one.cpu_times()[:2]) for one in root.children(recursive=True))


def main() -> None:
    """Print the figures and their targets, and write them as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/report_page"))
    parser.add_argument("--run", type=Path, help="an existing run; else one is made")
    parser.add_argument("--openings", type=int, default=3)
    given = parser.parse_args()
    reason = chromium.why_not()
    if reason:
        raise SystemExit(f"error: {reason}")
    given.out.mkdir(parents=True, exist_ok=True)
    run = given.run
    if run is None:
        run = simulate("highway", given.out / "run", seed=2, duration_s=120.0, fraction=0.11)
    begin = time.process_time()
    page = write_report(run, given.out / "report.html")
    took = time.process_time() - begin
    steps = read_table(run, "steps")
    openings = [measure(page) for _ in range(given.openings)]
    waits = [wait for one in openings for wait in one["slider_ms"]]
    figures = {
        "simulated_s": round(float(steps["time_s"].max() - steps["time_s"].min()) + 0.1, 1),
        "vehicles": int(steps["vehicle_id"].nunique()),
        "vehicles_at_a_time": round(len(steps) / steps["time_s"].nunique(), 1),
        "vehicle_steps": len(steps),
        "size_mb": page.stat().st_size / 1e6,
        "made_in_cpu_s": took,
        "load_ms": statistics.median(one["load_ms"] for one in openings),
        "plots_ms": statistics.median(one["plots_ms"] for one in openings),
        "cpu_s": statistics.median(one["cpu_s"] for one in openings),
        "slider_ms": statistics.median(waits) if waits else None,
        "slider_worst_ms": max(waits) if waits else None,
        "console": [line for one in openings for line in one["console"]],
        "load_average": psutil.getloadavg()[0],
    }
    (given.out / "report_page.json").write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    for name, value in figures.items():
        shown = f"{value:.2f}" if isinstance(value, float) else str(value)
        print(f"{name:20} {shown:>10}" + (f"   wanted: under {WANTED[name]:g}" if name in WANTED else ""))


if __name__ == "__main__":
    main()
