"""Command lines that users copy: the examples of `--help` and the lines of the README.

All of them are read as the command line reads them; those that take seconds are run as well. The slow ones (limit
cycles, flutter, studies, reproduction) are run by the tests of the tutorials and of their commands.
"""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path

import pytest

from docs.tools.command_pages import command_names, command_page
from docs.tools.examples import blocks_of, run_page
from workbench.cli.program import program

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
SERVE = {"ui"}  # until they are ended
SLOW = {
    "limit-cycle",
    "feedback",
    "feed-forward",
    "modes",
    "check",
    "identify",
    "calibrate",
    "tune",
    "run",
    "build",
}
# Files of the user's own, an FMU that has to be compiled, and measurements of many seconds.
NOT_RUN = re.compile(
    r"actuator[._]|identify nfr\.json|^workbench build|--compare|--json nfr\.json|^workbench (nfr|loop) loop\.toml"
)


def lines(text: str) -> list[str]:
    """The calls of the workbench in a block of commands, one each."""
    joined = (" ".join(line.split()) for line in text.replace("\\\n", " ").splitlines())
    return [line for line in joined if line.startswith("workbench ")]


def quick(text: str) -> list[str]:
    return [line for line in lines(text) if line.split()[1] not in SLOW | SERVE and not NOT_RUN.search(line)]


@cache
def examples_of(name: str) -> list[str]:
    """The examples of `--help` of a command; not while tests are collected, as commands take a second to make."""
    blocks = re.findall(r"^```bash\n(.*?)^```$", command_page(name).partition("**Example")[2], re.MULTILINE | re.DOTALL)
    return [line for block in blocks for line in lines(block) if "[OPTIONS]" not in line]  # that is how it is used


LINES = [line for block in blocks_of(README) if block.language == "sh" for line in lines(block.text)]


def is_command_line(line: str) -> bool:
    """Whether a command takes the line and is given something by it."""
    _, name, *words = shlex.split(line, comments=True)
    command = program(name)
    with command.make_context(name, words) as context:
        sources = [context.get_parameter_source(p.name) for p in command.params]
    return any(s is not None and s.name == "COMMANDLINE" for s in sources)


@pytest.mark.parametrize("name", command_names())
def test_the_examples_of_a_command_are_command_lines_of_it(name: str) -> None:
    found = examples_of(name)
    assert {line.split()[1] for line in found} == {name}
    assert [line for line in found if not is_command_line(line)] == []


@pytest.mark.parametrize("line", LINES)
def test_what_is_copied_from_the_readme_is_a_command_line(line: str) -> None:
    assert is_command_line(line)


def test_quick_examples_of_help_run(tmp_path: Path) -> None:
    every = [line for name in command_names() for line in examples_of(name)]
    found = sorted(quick("\n".join(every)), key=lambda line: "workbench trim" not in line)  # it writes trim.json
    assert len(found) > 5
    run_page("\n".join(["```sh", *found, "```", ""]), tmp_path)


def test_quick_lines_of_the_readme_run(tmp_path: Path) -> None:
    """Its files, Python and quick commands, in their order and in one folder."""
    page = []
    for block in blocks_of(README):
        text = "\n".join([*quick(block.text), ""]) if block.language == "sh" else block.text
        title = f' title="{block.title}"' if block.title else ""
        page.append(f"```{block.language}{title}\n{text}```\n")
    assert run_page("\n".join(page), tmp_path)
