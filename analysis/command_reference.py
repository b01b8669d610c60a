"""All commands and options as Markdown: `python -m analysis.command_reference > docs/commands.md`."""

from typing import Any

import typer
from typer.cli import get_docs_for_click

from analysis.cli import app

_HEADER = """# Commands

Generated from the commands by `python -m analysis.command_reference > docs/commands.md`; the option
`--help` of each command prints the same. Errors are one line on standard error and exit status 2.

"""


def reference() -> str:
    """The Markdown text."""
    command = typer.main.get_command(app)
    context: Any = command.make_context("sumo-adas", [], resilient_parsing=True)
    text = get_docs_for_click(obj=command, ctx=context, name="sumo-adas")
    body = text.split("**Usage**:", 1)[1]
    return _HEADER + "**Usage**:" + body.rstrip() + "\n"


if __name__ == "__main__":
    print(reference(), end="")
