"""Does the description conform to the FMI standard?"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from workbench.analysis.check.result import Answer
from workbench.errors import one_line
from workbench.fmi.description import Description
from workbench.fmi.fmpy_access import model_description

__all__ = ["structured_name", "validation"]

_WORD = r"[_A-Za-z][_A-Za-z0-9]*"
_QUOTED = r"""'(?:[-_A-Za-z0-9!#$%&()*+,./:;<>=?@\[\]^{}|~ ]|\\['"?\\abfnrtv])+'"""
_PART = rf"(?:{_WORD}|{_QUOTED})(?:\[\d+(?:,\d+)*\])?"
_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"
_STRUCTURED = re.compile(rf"(?:{_IDENTIFIER}|der\({_IDENTIFIER}(?:,\d+)?\))\Z")


def validation(folder: Path, description: Description) -> Answer:
    """Read modelDescription.xml strictly: schema, unique names, start values, causalities, units, model structure.

    FMPy's validation does it; names under the structured convention are compared with the grammar of FMI 2.0.4,
    section 2.2.9, here (FMPy's parser takes seconds for thousands of variables). Watch: rules are stretched; the
    workbench reads the file nevertheless, and `consequence` says what it made of it. A file that cannot be read at all
    never gets a card: the command ends with the reason.

    Args:
        folder: of the unpacked FMU.
        description: as the workbench read it, leniently.
    """
    problems = [*_problems(folder), *_names(folder)]
    if not problems:
        text = f"FMI {description.fmi_version}: {len(description.variables)} variables, no rule violated"
        return Answer("good", text, numbers={"problems": []})
    more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
    read = "; ".join(description.notes) or "it is read nevertheless; nothing is lost"
    return Answer("watch", problems[0] + more, read, {"problems": problems[:100]})


def _problems(folder: Path) -> list[str]:
    try:
        model_description.read_model_description(str(folder), validate=True, validate_model_structure=True)
    except model_description.ValidationError as error:
        return [one_line(p) for p in error.problems]
    except Exception as error:  # noqa: BLE001  FMPy raises bare Exception for broken rules
        return [one_line(str(error))]
    return []


def _names(folder: Path) -> list[str]:
    try:
        raw: Any = model_description.read_model_description(str(folder), validate=False)
    except Exception:  # noqa: BLE001  told by _problems
        return []
    if raw.variableNamingConvention != "structured":
        return []
    wrong = [v for v in raw.modelVariables if not structured_name(v.name)]
    return [f"'{v.name}' (line {v.sourceline}) is not a structured name" for v in wrong]


def structured_name(name: str) -> bool:
    """Whether a name keeps the structured naming convention: identifiers, dots, indices, one der( ).

    Args:
        name: of a variable.
    """
    return _STRUCTURED.match(name) is not None
