"""The analyses by the names of their commands; each is imported when it is asked for."""

from __future__ import annotations

from typing import Any

from workbench.analysis.request import Request
from workbench.core.named import named

__all__ = ["REQUESTS", "request_of"]

# In the order of a working day; those that are not analyses have packages of their own.
REQUESTS = {
    "info": "info.request:Info",
    "simulate": "simulate.request:Simulate",
    "nfr": "nfr.request:Nfr",
    "branches": "branches.request:Branches",
    "trim": "trim.request:Trim",
    "lin": "lin.request:LinCommand",
    "loop": "loop.request:Loop",
    "delays": "delays.request:Delays",
    "onset": "onset.request:RateOnset",
    "limit-cycle": "limit_cycle.request:LimitCycles",
    "feedback": "feedback.request:Feedback",
    "feed-forward": "feed_forward.request:FeedForward",
    "modes": "modes.request:Modes",
    "envelope": "workbench.study.envelope.request:EnvelopeOf",
    "compare": "motions.request:CompareMotions",
    "check": "check.request:Check",
    "excite": "excite.request:Excite",
    "identify": "structures.request:IdentifyCommand",
    "bla": "bla.request:BlaCommand",
    "fit": "fit.request:Fit",
    "reproduce": "workbench.reproduce.request:ReproduceCommand",
    "blocks": "blocks.request:Blocks",
    "build": "workbench.to_fmu.request:Build",
    "compile": "workbench.to_fmu.request:Compile",
    "export": "workbench.to_fmu.request:Export",
}


def request_of(command: str) -> type[Request[Any, Any]]:
    """Return the class of what a command asks for.

    Args:
        command: one of `REQUESTS`.
    """
    place = REQUESTS[command]
    found: type[Request[Any, Any]] = named(place if place.startswith("workbench.") else f"workbench.analysis.{place}")
    return found
