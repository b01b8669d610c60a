"""Commands, options, keys, imports and files named in README and docs exist."""

import ast
import importlib
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from analysis.cli import app
from plugin.configuration import configuration_from

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
OURS = ("analysis", "plugin", "sumo_net", "camera_synth", "radar_synth", "ego_synth")


def blocks(page: Path, language: str) -> Iterator[str]:
    """The fenced blocks of a language ('' for none) in a page."""
    text = page.read_text(encoding="utf-8")
    for found in re.finditer(r"^```(\w*)[^\n]*\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        if found[1] == language:
            yield found[2]


def commands() -> list[str]:
    """Every line of a block that calls sumo-adas, without its comment."""
    lines = [line for page in PAGES for block in blocks(page, "") for line in block.splitlines()]
    return [line.split("sumo-adas ", 1)[1] for line in lines if re.match(r"(\S+ -a )?sumo-adas ", line)]


@pytest.mark.parametrize("line", sorted(set(commands())))
def test_a_command_is_understood(line: str) -> None:
    name, *words = shlex.split(line.split(">")[0], comments=True)
    group: Any = typer.main.get_command(app)
    assert name in group.commands
    group.commands[name].make_context(name, words)  # parses options and values, runs nothing


def test_there_are_commands_to_look_at() -> None:
    assert len(set(commands())) > 40


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_code_can_be_read_and_finds_what_it_imports(page: Path) -> None:
    for block in blocks(page, "python"):
        for node in ast.walk(ast.parse(block)):
            if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in OURS:
                module = importlib.import_module(str(node.module))
                for name in node.names:
                    found = hasattr(module, name.name)
                    assert found or importlib.import_module(f"{node.module}.{name.name}")
    for block in blocks(page, "toml"):
        tomllib.loads(block)


@pytest.mark.parametrize(
    "block", blocks(ROOT / "docs" / "runs.md", "toml"), ids=lambda block: block.split()[0]
)
def test_the_scenario_files_of_the_how_to_are_such(block: str) -> None:
    configuration_from(tomllib.loads(block))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_to_pages_and_pictures_are_not_broken(page: Path) -> None:
    """mkdocs checks those of the site; this also those of the README."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", text):
        assert (page.parent / target).exists(), target
