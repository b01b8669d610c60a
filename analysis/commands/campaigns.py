"""Commands on many runs: `batch`, `sweep`."""

import enum
from pathlib import Path
from typing import Annotated

import typer

from analysis.commands.common import errors, plain_errors


class Kind(enum.StrEnum):
    """Which warning."""

    LDW = "ldw"
    FCW = "fcw"


def sweep(
    directory: Annotated[str, typer.Argument(help="Directory of a campaign that kept steps.", metavar="DIR")],
    kind: Annotated[
        Kind, typer.Option("--kind", help="ldw: lane departure; fcw: forward collision.")
    ] = Kind.LDW,
    threshold: Annotated[
        str, typer.Option("--threshold", metavar="FROM:TO:STEP", help="Thresholds in s.")
    ] = "0.2:2.0:0.1",
) -> None:
    """Evaluate other warning thresholds on the stored times to crossing or collision: hits, misses, false."""
    from analysis.campaign.sweep import sweep as judge
    from analysis.campaign.sweep import thresholds

    with plain_errors():
        table = judge(directory, kind.value, thresholds(threshold))
        typer.echo(table.to_string(index=False, float_format=lambda value: f"{value:.3f}"))
        typer.echo(f"Table: {directory}/sweep_{kind.value}.csv")


def batch(
    campaign: Annotated[Path, typer.Argument(help="The campaign file.", metavar="CAMPAIGN.toml")],
    out: Annotated[
        str, typer.Option("--out", help="Directory, or any fsspec address.", metavar="DIR")
    ] = "out/campaign",
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, metavar="N", help="Runs at once; default: one per core.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="An existing Dask scheduler.")
    ] = None,
    dry_run: Annotated[
        bool,
        typer.Option(
            "--dry-run",
            help="List the runs, which are done in --out, and the others' estimated cost; run nothing.",
        ),
    ] = False,
    keep: Annotated[
        str,
        typer.Option(
            "--keep", metavar="TABLES", help="Tables to keep of every run, for example steps,tracks."
        ),
    ] = "",
    compare_paper: Annotated[
        bool, typer.Option("--compare-paper", help="Also evaluate the published search on every frame.")
    ] = False,
) -> None:
    """Run a campaign, or its missing runs, and write its report."""
    from analysis.campaign import cost, engine, plan
    from analysis.campaign.progress import shown
    from analysis.campaign.report import write_report
    from analysis.campaign.store import Store

    with plain_errors():
        runs = plan.load(campaign, keep=tuple(name for name in keep.split(",") if name))
        if dry_run:
            runs, missing, *_ = engine.resumed(runs, Store(out), compare_paper)
            left = {one.key for one in missing}
            for one in runs.runs:
                done = "" if one.key in left else "  (done)"
                typer.echo(f"{one.key}  {Path(one.scenario).name}  {plan.in_words(one)}{done}")
            there = len(runs.runs) - len(missing)
            typer.echo(f"{len(runs.runs)} runs in {len(runs.cells)} cells, {there} done in {out}")
            typer.echo(f"{len(missing)} to run, {cost.estimate(missing, runs.campaign.keep, workers)}")
            return
        try:
            with shown() as tell:
                failures = engine.run(
                    runs,
                    out,
                    workers=workers,
                    scheduler=scheduler,
                    compare_paper=compare_paper,
                    tell=tell,
                )
        except KeyboardInterrupt:
            errors.print(f"interrupted: the runs so far are in {out}; the same command continues from there")
            raise typer.Exit(130) from None
        tables = write_report(out)
        rates = tables["rates"]
        if len(rates):
            whole = rates[rates["cell"] == "all"]
            columns = ["figure", "count", "per_100km", "per_100km_poisson_low", "per_100km_poisson_high"]
            typer.echo(f"{len(tables['runs'])} runs, {whole['distance_km'].iloc[0]:.1f} km")
            typer.echo(whole[columns].to_string(index=False, float_format=lambda value: f"{value:.2f}"))
        typer.echo(f"Report: {out}")
        for key, failure in failures.items():
            errors.print(f"failed: {key} ({failure.get('attempts')} attempts): {failure.get('cause')}")
        if failures:
            raise typer.Exit(1)
