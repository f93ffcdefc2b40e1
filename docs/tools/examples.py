r"""Run the examples of a page, and compare what they show with what the page says.

In the Markdown of a page, in their order:
  - a block `sh` holds commands, one a line (`\` continues it): `workbench …`, or `echo $?`, the exit code;
  - a block `python` is run, with the names of those before it;
  - a block of any language with `title="name"` is a file, written to the folder of the page;
  - a block `text` right after a run holds what was shown. A line `…` stands for any number of lines, ` …`
    at the end of a line for the rest of it.
Blocks in other languages (`bash`, for what cannot be run here) are only read.
"""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

from docs.tools.comparison import difference
from workbench.cli.app import run

__all__ = ["Block", "ExampleError", "Shown", "blocks_of", "compare", "pictures_of", "run_page", "with_shown"]

_FENCE = re.compile(r"^```(?P<language>[a-z]+)?(?P<rest>[^\n`]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL)
_TITLE = re.compile(r'title="(?P<name>[^"]+)"')
_PICTURE = re.compile(r"!\[[^\]]*\]\((?:\.\./)*pictures/(?P<page>[\w-]+)/(?P<name>[\w.-]+)\)")
_EXIT_CODE = "echo $?"
_FIRST_TIME = "this machine does so for the first time"  # a note of the compiler that a page does not show


@dataclass(frozen=True)
class Block:
    """A fenced block.

    Attributes:
        language: after the fence; "" where there is none.
        title: name of the file that it is; "" where it is none.
        text: inside.
        line: of the page, where it begins.
        start, end: where `text` lies in the page.
    """

    language: str
    title: str
    text: str
    line: int
    start: int
    end: int


@dataclass(frozen=True)
class Shown:
    """What a run showed.

    Attributes:
        run: the block that was run.
        text: standard output and standard error, in their order.
        expected: the block that says what is shown; None where the page does not say.
    """

    run: Block
    text: str
    expected: Block | None

    @property
    def gaps(self) -> bool:
        """Whether the page leaves lines out."""
        return self.expected is not None and any(line.endswith("…") for line in self.expected.text.splitlines())


class ExampleError(AssertionError):
    """A page shows something else than its examples do."""


@dataclass
class _Page:
    """The state between the blocks of a page.

    Attributes:
        names: of the Python blocks.
        code: exit code of the last command.
    """

    names: dict[str, object] = field(default_factory=lambda: {"__name__": "__main__"})
    code: int = 0


def blocks_of(page: str) -> list[Block]:
    """Return the fenced blocks of a page, in their order."""
    found = []
    for match in _FENCE.finditer(page):
        title = _TITLE.search(match["rest"])
        found.append(
            Block(
                match["language"] or "",
                title["name"] if title else "",
                match["text"],
                page.count("\n", 0, match.start()) + 1,
                match.start("text"),
                match.end("text"),
            )
        )
    return found


def pictures_of(page: str) -> list[tuple[str, str]]:
    """Return (page's name, file) of the pictures that a page shows from `pictures/`."""
    return [(match["page"], match["name"]) for match in _PICTURE.finditer(page)]


def run_page(page: str, folder: Path) -> list[Shown]:
    """Run all examples of a page in a folder.

    Args:
        page: its Markdown.
        folder: where files are written; it becomes the current one meanwhile.

    Raises:
        ExampleError: a block cannot be run, or ends with an exit code that the page does not show.
    """
    blocks = blocks_of(page)
    shown = []
    state = _Page()
    with contextlib.chdir(folder):
        for block, following in zip(blocks, [*blocks[1:], None], strict=False):
            if block.title:
                Path(block.title).write_text(block.text, encoding="utf-8")
            elif block.language in _RUNNERS:
                text = _RUNNERS[block.language](block, state)
                expected = following if following is not None and following.language == "text" else None
                shown.append(Shown(block, text, expected))
    return shown


def compare(shown: list[Shown]) -> Iterator[str]:
    """Yield a message for each block whose page says something else than was shown."""
    for one in shown:
        if one.expected is not None:
            words = difference(one.expected.text, one.text)
            if words:
                yield f"line {one.expected.line}: {words}"


def with_shown(page: str, shown: list[Shown]) -> str:
    """Return a page whose `text` blocks hold what was shown; those with a line `…` stay as they are."""
    for one in reversed(shown):
        if one.expected is not None and not one.gaps:
            page = page[: one.expected.start] + _tidy(one.text) + page[one.expected.end :]
    return page


def _tidy(text: str) -> str:
    lines = [line.rstrip() for line in text.strip("\n").splitlines()]
    return "\n".join(lines) + "\n"


def _run_shell(block: Block, state: _Page) -> str:
    """Run the lines of a block in this process; a failure must be shown by the page."""
    out = io.StringIO()
    commands = block.text.replace("\\\n", " ").splitlines()
    for line in filter(None, (c.strip() for c in commands)):
        if line == _EXIT_CODE:
            out.write(f"{state.code}\n")
            continue
        words = shlex.split(line, comments=True)
        if not words or words[0] != "workbench":
            raise ExampleError(f"line {block.line}: only commands of the workbench can be run, not '{line}'")
        with _captured(out), mock.patch.object(sys, "argv", words):
            state.code = run(words[1:])
        if state.code and _EXIT_CODE not in block.text:
            raise ExampleError(f"line {block.line}: '{line}' ended with exit code {state.code}:\n{out.getvalue()}")
    return "".join(line for line in out.getvalue().splitlines(keepends=True) if _FIRST_TIME not in line)


def _run_python(block: Block, state: _Page) -> str:
    out = io.StringIO()
    with _captured(out):
        exec(compile(block.text, f"line {block.line}", "exec"), state.names)  # noqa: S102 - the page's own example
    return out.getvalue()


_RUNNERS = {"sh": _run_shell, "python": _run_python}


@contextlib.contextmanager
def _captured(out: io.StringIO) -> Iterator[None]:
    """Standard output and error go to `out`, as one stream without a terminal."""
    plain = {"NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "110"}
    with (
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
        mock.patch.dict(os.environ, plain),
        mock.patch("workbench.requests.progress_bar.FIRST_LINE", math.inf),  # a slow machine shows no more than another
    ):
        os.environ.pop("FORCE_COLOR", None)
        yield
