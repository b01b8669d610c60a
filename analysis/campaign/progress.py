"""Progress of a campaign on the terminal."""

import contextlib
import math
import time
from collections.abc import Callable, Iterator

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar

from analysis.campaign.engine import Progress


@contextlib.contextmanager
def shown() -> Iterator[Callable[[Progress], None]]:
    """A bar with rate, remaining time and failures; occasional lines if there is no terminal."""
    console = Console(stderr=True, highlight=False)
    words = TextColumn("{task.description}")
    columns = (TextColumn("runs"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), words)
    with Bar(*columns, console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task("starting")
        begin: list[tuple[float, int]] = []
        last = [-math.inf]

        def tell(progress: Progress) -> None:
            now = time.monotonic()
            begin[:] = begin or [(now, progress.done + progress.failed)]
            finished = progress.done + progress.failed
            rate = (finished - begin[0][1]) / max(now - begin[0][0], 1e-9)
            words = f"{progress.failed} failed"
            if rate > 0.0 and finished > begin[0][1]:
                left = (progress.total - finished) / rate
                words = f"{60.0 * rate:.1f} a minute, {left / 60.0:.1f} min left, {words}"
            bar.update(task, total=progress.total, completed=finished, description=words)
            if not console.is_terminal and (now - last[0] > 60.0 or finished == progress.total):
                last[0] = now
                console.print(f"{finished} of {progress.total} runs, {words}")

        yield tell
