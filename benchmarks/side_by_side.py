"""Common parts of the comparisons with other software: processor time, and a table, printed and as JSON."""

import json
import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rich.console import Console
from rich.table import Table

T = TypeVar("T")


def cpu_seconds(function: Callable[[], T], repeats: int = 1) -> tuple[float, T]:
    """Median processor time of this process over `repeats` calls, and what the last call returned."""
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        result = function()
        spent.append(time.process_time() - begin)
    return float(np.median(spent)), result


def report(title: str, rows: list[dict[str, Any]], out: Path, packages: tuple[str, ...], note: str) -> None:
    """Print the rows, and write them with the versions of `packages` to `out`."""
    console = Console(highlight=False, width=120)
    table = Table(title=title, title_justify="left", box=None)
    for name in rows[0]:
        table.add_column(name, justify="left" if isinstance(rows[0][name], str) else "right")
    for row in rows:
        table.add_row(*(value if isinstance(value, str) else f"{value:.4g}" for value in row.values()))
    console.print(table)
    console.print(note, soft_wrap=True)
    out.parent.mkdir(parents=True, exist_ok=True)
    result = {
        "title": title,
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "load_average": os.getloadavg()[0],
        "versions": {name: version(name) for name in packages},
        "note": note,
        "rows": rows,
    }
    out.write_text(json.dumps(result, indent=2, ensure_ascii=False) + "\n")
    console.print(f"written: {out}", soft_wrap=True)
