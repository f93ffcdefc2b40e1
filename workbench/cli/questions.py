"""The question that a command asks at a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from workbench.errors import InputError

if TYPE_CHECKING:
    from workbench.cli.output import Output
    from workbench.identification.identify.request import Identify

__all__ = ["before"]

Before = Callable[[Any, Mapping[str, Any], "Output"], Any]


def before(command: str) -> Before | None:
    """Return what is called with the request, its options and the files, and returns the request that is run.

    Args:
        command: its name.
    """
    return _ordered if command == "identify" else None


def _ordered(request: Identify, given: Mapping[str, Any], out: Output) -> Identify:
    """Ask for the order where that is wanted."""
    return replace(request, order=_ask(request, given["data"], out)) if given["order"] == "ask" else request


def _ask(request: Identify, data: str, out: Output) -> int:
    """Show singular values and principal angles, and ask for the order."""
    from workbench.identification.identify.page import order_section
    from workbench.jobs.job import Job
    from workbench.show.terminal import section_text

    if not sys.stdin.isatty():
        raise InputError("--order ask: there is no terminal to ask; give a number or auto")
    proposal = replace(request, validation=None, lin=None, nfr=None, amplitude=None).run(data, Job())
    out.say(lambda width: section_text(order_section(proposal), width))
    answer = str(click.prompt(f"order (0 … {request.max_order})", default=str(proposal.order))).strip()
    if answer == "auto":
        return proposal.order
    if not answer.isdecimal():
        raise InputError(f"--order: '{answer}' is neither auto nor a number of states, 0 (a gain) or more")
    return int(answer)
