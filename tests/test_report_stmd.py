"""The metadata beside a page (SSP Traceability): the same facts, in the structure of the standard."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from lxml import etree

import workbench as wb
from tests.report_pages import changed_lag, facts_of_page, page, read_page
from workbench.requests.kept import origin_of
from workbench.show.result import write_report
from workbench.show.verdicts import Verdict


@pytest.fixture(scope="module")
def changed() -> wb.NfrResult:
    return changed_lag()


def test_the_same_facts_stand_beside_the_page_as_traceability_metadata(changed: wb.NfrResult, tmp_path: Path) -> None:
    changed.report(tmp_path / "p.html")
    names = {
        "stmd": "http://ssp-standard.org/SSPTraceability1/SimulationTaskMetaData",
        "stc": "http://ssp-standard.org/SSPTraceability1/SSPTraceabilityCommon",
    }
    root = etree.parse(tmp_path / "p.stmd").getroot()
    assert root.tag == f"{{{names['stmd']}}}SimulationTaskMetaData"
    assert {"version", "name", "GUID"} <= set(root.keys())
    entries = root.findall("stmd:GeneralInformation/stc:Classification/stc:ClassificationEntry", names)
    told = {e.get("keyword"): e.text for e in entries}
    facts = facts_of_page(read_page(tmp_path / "p.html"))
    assert told == facts
    (fmu,) = root.findall("stmd:ExecutionPhase/stmd:ExecuteSimulation/stc:Input/stc:Resource", names)
    assert (fmu.get("kind"), fmu.get("source")) == ("model", "FirstOrderLag.fmu")
    assert facts["SHA-256"] in [e.text for e in fmu.iter()]
    order = [etree.QName(e).localname for e in root.find("stmd:ExecutionPhase/stmd:ExecuteSimulation", names)]
    assert order == ["Input", "Procedure", "Output"]


# What may stand in an element, in this order, as SSP Traceability 1.0 words it.
STEP = ("Input", "Procedure", "Output", "Rationale", "Links", "LifeCycleInformation", "Classification", "Annotations")
PARTICLE = ("Resource", "Classification", "Annotations")
STMD_CHILDREN = {
    "SimulationTaskMetaData": (
        "GeneralInformation", "AnalysisPhase", "RequirementsPhase", "DesignPhase", "ImplementationPhase",
        "ExecutionPhase", "EvaluationPhase", "FulfillmentPhase", "Classification", "Annotations",
    ),
    "GeneralInformation": ("DerivationChain", "Resource", "Links", "Classification", "Annotations"),
    "ExecutionPhase": ("ExecuteSimulation", *STEP[4:]),
    "EvaluationPhase": ("EvaluateSimulationResults", "AssureSimulationQuality", *STEP[4:]),
    "ExecuteSimulation": STEP, "EvaluateSimulationResults": STEP, "Input": PARTICLE, "Procedure": PARTICLE,
    "Output": PARTICLE, "Resource": ("Content", "Summary", "MetaData", "Signature", "Classification", "Annotations"),
    "Classification": ("ClassificationEntry",), "ClassificationEntry": (), "Content": (),
}  # fmt: skip
STMD_REQUIRED = {
    "SimulationTaskMetaData": {"version", "name", "GUID"},
    "Resource": {"kind", "type"},
    "ClassificationEntry": {"keyword"},
}
STMD_ALLOWED = {
    "SimulationTaskMetaData": {
        "version", "name", "GUID", "id", "description", "author", "fileversion", "copyright", "license",
        "generationTool", "generationDateAndTime",
    },
    "Resource": {"kind", "type", "source"}, "ClassificationEntry": {"keyword"}, "Classification": {"type"},
}  # fmt: skip
STMD_KINDS = {
    "document", "requirement", "specification", "model", "parameter", "system", "testcase", "result", "method",
    "rationale", "report", "request", "delivery", "executable", "configuration",
}  # fmt: skip


@pytest.mark.parametrize("author", ["", "J. Doe"])
def test_the_metadata_has_the_structure_of_the_standard(author: str, tmp_path: Path, changed: wb.NfrResult) -> None:
    known = origin_of(changed)
    assert known is not None
    full = replace(known, files={"a b.csv": "0" * 64}, call="workbench nfr lag.fmu")
    facts = {"author": author} if author else {}
    write_report(page(facts=facts, summary=[Verdict("good", "text")]), tmp_path / "p.html", full)
    root = etree.parse(tmp_path / "p.stmd").getroot()
    for element in root.iter():
        name, keys = etree.QName(element).localname, set(element.keys())
        children = [etree.QName(child).localname for child in element]
        places = [STMD_CHILDREN[name].index(child) for child in children]
        assert places == sorted(places), (name, children)
        assert STMD_REQUIRED.get(name, set()) <= keys <= STMD_ALLOWED.get(name, set()), (name, keys)
        if name == "Resource":
            assert element.get("kind") in STMD_KINDS
            assert ("source" in keys) != ("Content" in children)  # one of them, never both
            assert " " not in element.get("source", "")  # a URI
    assert re.fullmatch(r"[0-9]+[.][0-9]+([.][0-9]+)?(-.*)?", root.get("version", ""))
    assert [e.text for e in root.iter() if e.getparent() is not None and "a%20b.csv" in source_of(e)] == ["0" * 64]


def source_of(entry: etree._Element) -> str:
    """Return the file that an entry of a resource's classification belongs to."""
    resources = [e for e in entry.iterancestors() if etree.QName(e).localname == "Resource"]
    return resources[0].get("source", "") if resources and entry.get("keyword") else ""


def test_a_text_that_xml_cannot_hold_does_not_stop_the_metadata(tmp_path: Path) -> None:
    write_report(page(facts={"na\x01me": "a\x00b\ufffe"}), tmp_path / "p.html")
    told = [e.text for e in etree.parse(tmp_path / "p.stmd").getroot().iter() if e.get("keyword", "").startswith("na")]
    assert len(told) == 1
    assert told[0].startswith("a")
