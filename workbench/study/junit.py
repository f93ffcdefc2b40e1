"""A study's requirements as JUnit XML, which every CI shows."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from workbench.core.machine.files import replacing
from workbench.study.plan import PlannedRun

if TYPE_CHECKING:
    from workbench.study.result import RequirementResult, StudyResult

__all__ = ["write_junit"]

# XML 1.0 has no way to write these.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def write_junit(result: StudyResult, path: str | Path) -> None:
    """Write one test case for each requirement at each point, and one for each analysis that failed without any.

    A requirement that is not met is a failure; one whose analysis gave no result is an error.

    Args:
        result: of the study.
        path: of the file.

    Raises:
        InputError: the file cannot be written.
    """
    suite = ET.Element("testsuite", {"name": _clean(result.study.name)})
    shares = Counter(run for checked in result.checked for run in checked.runs)
    for checked in result.checked:
        seconds = sum(_seconds(result, run) / shares[run] for run in checked.runs)
        _case(suite, checked, seconds, lost=any(_lost(result, run) for run in checked.runs))
    for run, outcome in result.failed:
        if run not in shares:
            reason = outcome.reason or "points of it failed"
            case = _testcase(suite, f"analysis {run.label}", run.analysis.name, outcome.seconds)
            ET.SubElement(case, "error", {"message": _clean(reason), "type": outcome.kind or "failed"}).text = _clean(
                reason
            )
    root = ET.Element("testsuites", {"name": "workbench"})
    root.append(suite)
    for element in (suite, root):
        element.attrib.update(_counts(suite))
    ET.indent(root)
    with replacing(path) as part:
        ET.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _seconds(result: StudyResult, run: PlannedRun) -> float:
    """Time that an analysis took now; a reused one took none."""
    outcome = result.runs.get(run)
    return 0.0 if outcome is None or outcome.reused else outcome.seconds


def _lost(result: StudyResult, run: PlannedRun) -> bool:
    """Whether an analysis gave no result, which is an error rather than a failure."""
    return run not in result.runs or result.runs[run].result is None


def _case(suite: ET.Element, checked: RequirementResult, seconds: float, *, lost: bool) -> None:
    case = _testcase(suite, checked.name, checked.requirement.analysis, seconds)
    result = checked.finding
    if result.passed:
        ET.SubElement(case, "system-out").text = _clean(result.words)
        return
    kind = "error" if lost else "failure"
    message = _clean(result.words)
    ET.SubElement(case, kind, {"message": message, "type": checked.requirement.kind}).text = message


def _testcase(suite: ET.Element, name: str, analysis: str, seconds: float) -> ET.Element:
    classname = f"{suite.attrib['name']}.{_clean(analysis)}"
    return ET.SubElement(suite, "testcase", {"name": _clean(name), "classname": classname, "time": f"{seconds:.3f}"})


def _counts(suite: ET.Element) -> dict[str, str]:
    cases = suite.findall("testcase")
    seconds = sum(float(case.attrib["time"]) for case in cases)
    numbers = {"tests": len(cases), "failures": len(suite.findall("testcase/failure"))}
    numbers |= {"errors": len(suite.findall("testcase/error")), "skipped": 0}
    return {**{name: str(n) for name, n in numbers.items()}, "time": f"{seconds:.3f}"}


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("�", text)
