"""The commands in their groups, and the requests behind each; a request is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from workbench.core.records.lazy import homes_in
from workbench.core.records.plug_ins import ExtensibleTable
from workbench.requests.request import Request, function

__all__ = ["COMMANDS", "GROUPS", "MOVED", "REQUESTS", "added_functions", "request_of", "requests_of"]

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
        "robust": {"robust": "loops.robust.request:Robust"},
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
        "calibrate": {"calibrate": "identification.calibrate.request:Calibrate"},
    },
    "Projects": {
        "tune": {"tune": "study.tune.request:Tune"},
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

_OWN: Mapping[str, Mapping[str, str]] = dict(chain.from_iterable(group.items() for group in GROUPS.values()))


def _wrong(name: str, held: Any) -> str:  # noqa: ANN401 - whatever a plug-in has
    if not (isinstance(held, type) and issubclass(held, Request) and hasattr(held, "algorithm")):
        return "is not a request that names its algorithm, see workbench.requests.request.Request"
    if held.command != name:
        return f"its command is '{held.command}'; give both the same name"
    if _called(held) in homes_in(str(Path(__file__).with_name("__init__.pyi"))):
        return f"wb.{_called(held)} is the workbench's; give the request another name in Python (called)"
    return ""


def _called(request: type[Request[Any, Any]]) -> str:
    return request.called or request.command.replace("-", "_")


# Those of plug-ins have the name of their command.
REQUESTS: ExtensibleTable[type[Request[Any, Any]]] = ExtensibleTable(
    "commands",
    dict(chain.from_iterable(requests.items() for requests in _OWN.values())),
    _wrong,
    within="workbench",
    taken=(*_OWN, *MOVED),
)


class _Commands(Mapping[str, Sequence[str]]):
    """Command → names of its requests: some of the workbench's, then those of plug-ins, one request each.

    Args:
        own: the workbench's.
    """

    def __init__(self, own: Mapping[str, Sequence[str]]) -> None:
        self._own = own

    def __getitem__(self, name: str) -> Sequence[str]:
        if name in self._own:
            return self._own[name]
        if name in _OWN or name not in REQUESTS or not REQUESTS.package_of(name):
            raise KeyError(name)
        return (name,)

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from (plug_in.name for plug_in in REQUESTS.added())

    def __len__(self) -> int:
        return len(self._own) + len(REQUESTS.added())

    def without(self, *names: str) -> _Commands:
        """Return all but some of the workbench's."""
        return _Commands({name: requests for name, requests in self._own.items() if name not in names})


COMMANDS = _Commands({name: tuple(requests) for name, requests in _OWN.items()})


def request_of(name: str) -> type[Request[Any, Any]]:
    """Return a request's class.

    Args:
        name: one of `REQUESTS`.
    """
    return REQUESTS[name]


def requests_of(command: str) -> tuple[type[Request[Any, Any]], ...]:
    """Return the requests behind a command, the one that it is without more first.

    Args:
        command: one of `COMMANDS`.
    """
    return tuple(request_of(name) for name in COMMANDS[command])


def added_functions() -> dict[str, Callable[..., Any]]:
    """Return name → function in Python of the requests that plug-ins add."""
    requests = [REQUESTS[plug_in.name] for plug_in in REQUESTS.added()]
    return {_called(request): function(request) for request in requests}
