"""The analyses by the names of their commands; each is imported when it is asked for."""

from __future__ import annotations

from typing import Any

from workbench.core.records.named import named
from workbench.requests.request import Request

__all__ = ["MOVED", "REQUESTS", "request_of"]

# In the order of a working day; those that are not analyses have packages of their own.
REQUESTS = {
    "info": "health.info.request:Info",
    "simulate": "response.simulate.request:Simulate",
    "nfr": "response.nfr.request:Nfr",
    "branches": "response.branches.request:Branches",
    "trim": "point.trim.request:Trim",
    "lin": "response.compare_linear.request:LinCommand",
    "loop": "loops.loop.request:Loop",
    "delays": "health.delays.request:Delays",
    "onset": "loops.onset.request:RateOnset",
    "limit-cycle": "limit_cycles.limit_cycle.request:LimitCycles",
    "feedback": "limit_cycles.feedback.request:Feedback",
    "feed-forward": "limit_cycles.feed_forward.request:FeedForward",
    "modes": "point.modes.request:Modes",
    "envelope": "study.envelope.request:EnvelopeOf",
    "compare": "response.compare.request:CompareMotions",
    "check": "health.check.request:Check",
    "excite": "data.excite.request:Excite",
    "identify": "identification.structures.request:IdentifyCommand",
    "bla": "data.bla.request:BlaCommand",
    "fit": "identification.fit.request:Fit",
    "blocks": "health.blocks.request:Blocks",
    "build": "build.request:Build",
    "compile": "build.request:Compile",
    "export": "build.request:Export",
}

# What was a command → where it is now.
MOVED = {"reproduce": "python scripts/dev.py reproduce, in the project's source"}


def request_of(command: str) -> type[Request[Any, Any]]:
    """Return the class of what a command asks for.

    Args:
        command: one of `REQUESTS`.
    """
    found: type[Request[Any, Any]] = named(f"workbench.{REQUESTS[command]}")
    return found
