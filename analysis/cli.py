"""The command `sumo-adas`: its sub-commands are in `analysis.commands`."""

import gc
import io
import os
import signal
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer

from analysis.commands import campaigns, drives, pictures, protocols, recordings, simulation, studies
from analysis.commands.common import errors

app = typer.Typer(
    invoke_without_command=True, add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None
)
# newer releases of typer contain a copy of click: this finds the class in either
_UsageError: Any = typer.BadParameter.__base__


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point: every expected error is one line on standard error and exit status 2."""
    gc.set_threshold(50_000, 20, 20)  # objects of imports stay alive: fewer collections save time
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # keeps the rows, as Ctrl-C does
    for stream in (sys.stdout, sys.stderr):  # a question mark for what the terminal's encoding lacks
        if isinstance(stream, io.TextIOWrapper) and stream.errors == "strict":
            stream.reconfigure(errors="replace")
    try:
        status = app(arguments, standalone_mode=False)
    except _UsageError as error:
        where = error.ctx.command_path if error.ctx else "sumo-adas"
        errors.print(f"error: {_one_line(error.format_message())} (see {where} --help)")
        raise SystemExit(2) from None
    except ModuleNotFoundError as error:  # an interrupted installation
        errors.print(
            f"error: {error.name} is not installed: run `pip install sumo-adas`, or `make demo`, again"
        )
        raise SystemExit(2) from None
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python complains when it ends
        raise SystemExit(141) from None  # as of a process that SIGPIPE has ended
    except (KeyboardInterrupt, typer.Abort):
        raise SystemExit(130) from None
    raise SystemExit(status)


@app.callback()
def about(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the versions and exit.")] = False,
) -> None:
    """Lane-departure and rear-end warning for whole fleets in SUMO: runs, recordings, campaigns, pictures."""
    if version:
        from plugin.configuration import versions

        typer.echo(versions().replace("; ", "\n"))
    elif context.invoked_subcommand is None:
        typer.echo(context.get_help())


app.command(short_help="Run a scenario, write its tables, print a summary.")(simulation.run)
app.command()(simulation.scenarios)
app.command(short_help="Run a campaign, or what is missing of it.")(campaigns.batch)
app.command(short_help="Evaluate other warning thresholds on a campaign's steps.")(campaigns.sweep)
app.command(short_help="Make a video of a drive: camera, warnings, view from above.")(drives.video)
app.command()(recordings.detect)
app.command(short_help="Propose a camera file from images of a straight road.")(recordings.calibrate)
app.command()(recordings.track)
app.command(short_help="Write one HTML page on a run, a campaign or a recorded drive.")(pictures.report)
app.command(short_help="Draw one figure of a run, a campaign or a recorded drive.")(pictures.plot)
app.command(short_help="Run a published experiment and compare the results.")(studies.reproduce)
app.command(short_help="Run a test protocol; status 0 when it passes.")(protocols.protocol)
app.command(short_help="Measure accuracy over many seeds against the stated targets.")(studies.evaluate)


def _one_line(text: str) -> str:
    return " ".join(text.replace("Value error, ", "").split())
