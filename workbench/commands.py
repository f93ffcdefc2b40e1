"""The commands in their groups, and the requests behind each; a request is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from typing import Any

from workbench.core.records.named import named
from workbench.requests.request import Request

__all__ = ["COMMANDS", "GROUPS", "MOVED", "REQUESTS", "request_of", "requests_of"]

# Group of `workbench --help` → command → its requests by name. The first is what the command does unless it is given
# what another one takes, see `Request.takes`. `run` and `ui` are functions of the command line; behind `run` is the
# request for studies with an envelope.
GROUPS: Mapping[str, Mapping[str, Mapping[str, str]]] = {
    "Look": {
        "info": {"info": "health.info.request:Info", "blocks": "health.blocks.request:Blocks"},
        "check": {"check": "health.check.request:Check", "delays": "health.delays.request:Delays"},
    },
    "Run": {
        "simulate": {
            "simulate": "response.simulate.request:Simulate",
            "compare": "response.compare.request:CompareMotions",
        },
    },
    "Operating point": {
        "trim": {"trim": "point.trim.request:Trim"},
        "lin": {"lin": "response.compare_linear.request:LinCommand"},
        "modes": {"modes": "point.modes.request:Modes"},
    },
    "Frequency response": {
        "nfr": {"nfr": "response.nfr.request:Nfr"},
        "branches": {"branches": "response.branches.request:Branches"},
        "bla": {"bla": "data.bla.request:BlaCommand"},
    },
    "Closed loops": {
        "loop": {"loop": "loops.loop.request:Loop"},
        "limit-cycle": {"limit-cycle": "limit_cycles.limit_cycle.request:LimitCycles"},
        "onset": {"onset": "loops.onset.request:RateOnset"},
        "feedback": {"feedback": "limit_cycles.feedback.request:Feedback"},
        "feed-forward": {"feed-forward": "limit_cycles.feed_forward.request:FeedForward"},
    },
    "Data": {
        "excite": {"excite": "data.excite.request:Excite"},
        "identify": {
            "identify": "identification.structures.request:IdentifyCommand",
            "fit": "identification.fit.request:Fit",
        },
    },
    "Projects": {
        "run": {"envelope": "study.envelope.request:EnvelopeOf"},
        "build": {
            "build": "build.request:Build",
            "compile": "build.request:Compile",
            "export": "build.request:Export",
        },
        "schema": {},
        "ui": {},
    },
}
COMMANDS: Mapping[str, Mapping[str, str]] = dict(chain.from_iterable(group.items() for group in GROUPS.values()))
REQUESTS: Mapping[str, str] = dict(chain.from_iterable(requests.items() for requests in COMMANDS.values()))

# What was a command of its own before 1.0 → what does it now.
MOVED: Mapping[str, str] = {
    "blocks": "workbench info --blocks",
    "compare": "workbench simulate, with several models",
    "compile": "workbench build, with an FMU",
    "delays": "workbench check --delays",
    "envelope": "workbench run",
    "export": "workbench build, with a linear model or a system",
    "fit": "workbench identify, with a measured response",
    "reproduce": "python scripts/dev.py reproduce, in the project's source",
}


def request_of(name: str) -> type[Request[Any, Any]]:
    """Return a request's class.

    Args:
        name: one of `REQUESTS`.
    """
    result: type[Request[Any, Any]] = named(f"workbench.{REQUESTS[name]}")
    return result


def requests_of(command: str) -> tuple[type[Request[Any, Any]], ...]:
    """Return the requests behind a command, the one that it is without more first.

    Args:
        command: one of `COMMANDS`.
    """
    return tuple(request_of(name) for name in COMMANDS[command])
