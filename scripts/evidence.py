#!/usr/bin/env python3
"""How often promises are kept: errors, regions and verdicts of random models whose truth is known.

    python scripts/evidence.py                                the short form of all, in a minute (`dev.py evidence`)
    python scripts/evidence.py NAME [--cases N] [--seed S]    one in full; NAME --help shows what it is and its options

Exit code 1: a promise is not kept. The modules of scripts/promises are named here; the options of each are the
parameters of its `run`. Run it with the project's Python (see scripts/dev.py).
"""

from __future__ import annotations

import argparse
import inspect
import io
import os
import re
import sys
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

# Name → what its short form is run with; none: it only measures, and has nothing that it could miss.
SHORT: Mapping[str, tuple[Mapping[str, Any], ...]] = {
    "nfr": ({"cases": 40}, {"cases": 20, "nonlinear": True}),
    "sampled": ({"cases": 40},),
    "disturbed": ({"cases": 14},),
    "cosimulation": ({"cases": 8},),
    "motion": ({"cases": 2},),
    "multirate": ({"cases": 8},),
    "trim": ({"cases": 150},),
    "bla": ({"cases": 3},),
    "sessions": (),  # the tests have it
    "fit": (),
    "identify": (),
    "rudder": (),
    "calibrate": ({"cases": 2, "every": 7},),
    "tune": ({"cases": 6, "names": "AC4,HE1"},),
    "conflicts": ({"cases": 3},),
    "aileron": (),
    "mu": ({"cases": 100},),
    "disks": ({"cases": 6},),
    "robust": ({"cases": 6},),
}


def run_of(name: str) -> Callable[..., int]:
    """Return what measures one.

    Args:
        name: of the module.
    """
    found: Callable[..., int] = import_module(f"scripts.promises.{name}").run
    return found


def options_into(parser: argparse.ArgumentParser, function: Callable[..., int]) -> None:
    """Add the parameters of a function as options, with the words of its docstring.

    Args:
        parser: of the command line.
        function: with keywords only.
    """
    words = dict(re.findall(r"^ {4,}(\w+): (.+)$", inspect.getdoc(function) or "", re.MULTILINE))
    for name, parameter in inspect.signature(function, eval_str=True).parameters.items():
        flag, said = f"--{name.replace('_', '-')}", {"help": words[name].rstrip(".")}
        if parameter.annotation is bool:
            parser.add_argument(flag, action="store_true", **said)
        else:
            parser.add_argument(flag, type=parameter.annotation, default=parameter.default, **said)


def measured(name: str, form: Mapping[str, Any]) -> tuple[int, str]:
    """Run one with the parameters of its form, and return its exit code and what it said.

    Args:
        name: of the module.
        form: parameter → value.
    """
    words = " ".join(f"--{key} {value}" for key, value in form.items()).replace(" True", "")
    begin = time.monotonic()
    with redirect_stdout(io.StringIO()) as said:
        code = run_of(name)(**form)
    return code, f"-- {name} {words}\n{said.getvalue()}   {time.monotonic() - begin:.0f} s"


def short() -> int:
    """Run the short form of all, two beside each other, and return 1 if a promise is not kept."""
    names, forms = zip(*((name, form) for name, some in SHORT.items() for form in some), strict=True)
    broken = []
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        for name, (code, said) in zip(names, pool.map(measured, names, forms), strict=True):
            print(said, flush=True)
            if code:
                broken.append(name)
    print(f"not kept: {', '.join(broken)}" if broken else "all kept")
    return int(bool(broken))


def main(arguments: list[str] | None = None) -> int:
    """Run what the command line asks for, and return the exit code.

    Args:
        arguments: in place of the process's own.
    """
    words = sys.argv[1:] if arguments is None else arguments
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=SHORT, nargs="?", help="which; by default the short form of all")
    name = parser.parse_args(words[:1]).name
    if name is None:
        return short()
    function = run_of(name)
    own = argparse.ArgumentParser(
        prog=f"evidence.py {name}", description=sys.modules[function.__module__].__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    options_into(own, function)
    return function(**vars(own.parse_args(words[1:])))


if __name__ == "__main__":
    sys.exit(main())
