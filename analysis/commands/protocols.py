"""Command `protocol`: standard test procedures."""

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.progress import Progress

from analysis.commands.common import Mode, Out, errors, plain_errors
from plugin.warning.safe_distance import MODELS

ALL = "all"


def protocol(
    name: Annotated[
        str, typer.Argument(help="nhtsa-ldw, nhtsa-fcw, iso-17361, iso-15623-like, all, or FILE.toml.")
    ],
    out: Out = Path("out/protocol"),
    mode: Annotated[
        Mode, typer.Option(help="paper: the published chain; refined: the default one.")
    ] = Mode.REFINED,
    distance_model: Annotated[
        str | None,
        typer.Option(
            "--distance-model", metavar="M", help=f"Safe-distance model of the warning: {', '.join(MODELS)}."
        ),
    ] = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Also run paper mode and each safe-distance model.")
    ] = False,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1, metavar="N")] = 1,
    workers: Annotated[int, typer.Option(min=1, metavar="N", help="Runs at once.")] = 2,
) -> None:
    """Run a test protocol and write its tables; exit status 0 only when it passes.

    With --compare, only the default configuration determines the status.
    """
    from analysis.protocol import report
    from analysis.protocol.definition import load, protocols
    from analysis.protocol.running import worker_pool

    console = Console(highlight=False, width=None if Console().is_terminal else 140)
    good, rows = True, []
    with plain_errors():
        if distance_model is not None and distance_model not in MODELS:
            raise ValueError(f"--distance-model = {distance_model}: known are {', '.join(MODELS)}")
        chosen = {one: load(one) for one in (protocols() if name == ALL else [name])}
        with worker_pool(workers) as pool:
            for one, loaded in chosen.items():
                label = Path(one).stem
                runs = _compared(loaded) if compare else [(mode.value, distance_model)]
                for number, (chain, model) in enumerate(runs):
                    words = f"{label} {chain} {model or ''}".strip()
                    outcome = _drive(loaded, pool, words, chain, model, seed)
                    directory = out / f"{chain}_{model or 'default'}" if compare else out
                    report.write(outcome, label, directory)
                    if number == 0:
                        good = good and outcome.passed
                    if not compare:
                        report.show(outcome, label, console)
                    rows.append(report.comparison_row(label, chain, model or _default_model(), outcome))
        if compare:
            report.write_comparison(rows, out)
            console.print(report.comparison(rows))
        console.print(f"Tables: {out}", markup=False)
    if not good:
        raise typer.Exit(1)


def _compared(protocol: Any) -> list[tuple[str, str | None]]:
    """Modes and safe-distance models: the default one first."""
    others = [model for model in MODELS if model != _default_model()] if protocol.collision else []
    return [("refined", None), *(("refined", model) for model in others), ("paper", None)]


def _default_model() -> str:
    from plugin.warning.safe_distance import SafeDistance

    return SafeDistance().model


def _drive(protocol: Any, pool: Any, words: str, mode: str, model: str | None, seed: int) -> Any:
    from analysis.protocol.running import drive

    changes = {} if model is None else {"collision": {"distance": {"model": model}}}
    with Progress(transient=True, console=errors, disable=not errors.is_terminal) as progress:
        task = progress.add_task(words, total=None)

        def told(done: int, all_: int) -> None:
            progress.update(task, completed=done, total=all_)

        return drive(protocol, pool, mode=mode, changes=changes, seed=seed, told=told)
