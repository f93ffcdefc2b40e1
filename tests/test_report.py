"""Pages: every result has one; they stand alone; what they say of how a result was made is true."""

from __future__ import annotations

import gc
import hashlib
import html
import inspect
import json
import math
import re
import weakref
from collections.abc import Callable
from dataclasses import is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import workbench as wb
from tests.report_pages import changed_lag, check_page_file, data_of, facts_of_page, page, read_page
from tests.test_records import RECORDS, example
from workbench.cli.program import COMMANDS
from workbench.core.records.named import named
from workbench.core.records.record import plain
from workbench.fmi.archive import locate
from workbench.requests.decorator import with_origin
from workbench.requests.kept import origin_of, remember
from workbench.requests.origin import Origin
from workbench.show.facts import point_facts
from workbench.show.page import SUFFIXES, Page, PageTable, Section, write_page
from workbench.show.result import Reportable, Result, page_of, picture_of, write_report
from workbench.show.verdicts import TONES, Verdict, counted, tone, worst_first

# Data that results are made from, models, and parts of results: none is what an analysis answers with.
NO_RESULTS = {"Experiment", "IdentifiedModel"}


def public_classes() -> list[type]:
    return [v for name in wb.__all__ if inspect.isclass(v := getattr(wb, name))]


def answers() -> list[type]:
    """Public classes that can be drawn, and those that a public function returns and that go to JSON."""
    found = {c for c in public_classes() if hasattr(c, "plot")}
    for name in wb.__all__:
        function = getattr(wb, name)
        if inspect.isfunction(function):
            kind = getattr(wb, str(function.__annotations__.get("return")), None)
            if inspect.isclass(kind) and is_dataclass(kind) and hasattr(kind, "to_dict"):
                found.add(kind)
    return sorted((c for c in found if c.__name__ not in NO_RESULTS), key=lambda c: c.__name__)


@pytest.mark.parametrize("kind", answers(), ids=lambda c: c.__name__)
def test_every_result_has_a_page(kind: type[Reportable]) -> None:
    assert callable(kind.report)
    if getattr(kind, "report", None) is Reportable.report:
        assert kind._page


# Pages of these are text and tables, or hold the pictures of others.
WITHOUT_PICTURE = {
    "AbsoluteStability", "BalancedReduction", "BlocksResult", "BuildResult", "BuiltModels", "CompiledFmu",
    "ContainerResult", "DelayReport", "ExportResult", "FmuInfo", "NoDelays", "ReproduceResult", "SystemFile",
    "SystemInfo", "TargetList",
}  # fmt: skip


@pytest.mark.parametrize("kind", RECORDS, ids=lambda c: c.__name__)
def test_every_record_has_a_page_and_a_picture_or_says_that_there_is_none(kind: type[Result]) -> None:
    assert kind._page or kind.report is not Reportable.report
    if kind.__name__ in WITHOUT_PICTURE:
        with pytest.raises(wb.InputError, match=f"{kind.__name__} has no picture"):
            example(kind).plot()
    else:
        assert kind.plot is not Reportable.plot or kind._picture


# Made by `build`, which the command line has, and by the script `reproduce`.
NOT_PUBLIC = {"BuildResult", "BuiltModels", "ReproduceResult", "TargetList"}


@pytest.mark.parametrize("kind", RECORDS, ids=lambda c: c.__name__)
def test_every_record_is_a_public_class(kind: type[Result]) -> None:
    assert (getattr(wb, kind.__name__, None) is kind) != (kind.__name__ in NOT_PUBLIC), "a row in workbench/__init__.py"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_is_in_the_index_of_methods(command: str) -> None:
    docs = Path(__file__).parents[1] / "docs"
    methods = (docs / "methods" / "index.md").read_text(encoding="utf-8")
    assert f"`{command}`" in methods or command in NO_METHOD
    pages = (docs.parent / "properdocs.yml").read_text(encoding="utf-8")
    for name in re.findall(r"\]\(([\w-]+\.md)\)", methods):
        assert f"methods/{name}" in pages


NO_METHOD = {"info", "schema", "ui"}  # what the FMU says, what a file can hold, what all do


@pytest.mark.parametrize("kind", [c for c in answers() if issubclass(c, Reportable)], ids=lambda c: c.__name__)
def test_every_page_and_picture_is_there_and_takes_its_result(kind: type[Reportable]) -> None:
    for function, made in ((kind._page, Page), (kind._picture, Figure)):
        if function:
            assert function.startswith(kind.__module__.rpartition(".")[0]), "they stand in its folder"
            hints = named(function).__annotations__
            assert hints["return"] == made.__name__
            assert next(iter(hints.values())).rpartition(".")[2] in {c.__name__ for c in kind.__mro__}


def test_a_result_without_a_page_is_told(tmp_path: Path) -> None:
    with pytest.raises(wb.InputError, match="object has no page"):
        page_of(object())
    with pytest.raises(wb.InputError, match="object has no picture"):
        picture_of(object(), None)
    with pytest.raises(wb.InputError, match="has no page"):
        write_report(object(), tmp_path / "x.html")


# -- pages --------------------------------------------------------------------------------------


def saturation(*amplitudes: float) -> wb.DescribingFunction:
    return wb.describing_function(wb.standard_block("saturation"), amplitudes)


def test_the_violated_come_first(tmp_path: Path) -> None:
    given = [Verdict("passed", "gain"), Verdict("watch", "tail"), Verdict("odd", "thing"), Verdict("failed", "phase")]
    assert [v.text for v in worst_first(given)] == ["phase", "tail", "gain", "thing"]
    assert counted(given) == "1 × failed, 1 × watch, 1 × passed, 1 × odd"
    write_page(page(summary=given), tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    words = [e.text for e in found.elements if e.attributes.get("class", "").startswith("word")]
    assert words == ["failed", "watch", "passed", "odd"]
    (strip,) = [e for e in found.elements if e.attributes.get("class", "").startswith("summary")]
    assert strip.attributes["class"] == "summary poor"


def test_words_have_one_tone_each() -> None:
    words = [word for words in TONES.values() for word in words]
    assert len(words) == len(set(words))
    assert [tone(w) for w in ("Passed", " failed ", "averaged", "whatever")] == ["good", "poor", "watch", ""]


def test_numbers_stand_at_the_right() -> None:
    rows = [("x", "1", "1.2e-3", "−3 %", "2 Hz", ""), ("y", "-", "∞", "4", "3", "")]
    assert PageTable(("",) * 6, rows).at_right == {1, 2, 3}
    assert PageTable(("", ""), [("1", "2")], right=()).at_right == frozenset()


def test_text_of_others_is_no_markup(tmp_path: Path) -> None:
    evil = "</script><script>alert(1)</script><!-- \u2028"
    write_page(page(title=evil, notes=[evil], facts={"command": evil}, data={"x": evil}), tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    assert data_of(found) == {"x": evil}
    assert sum(e.tag == "script" for e in found.elements) == 2
    (heading,) = [e for e in found.elements if e.tag == "h1"]
    assert heading.text == evil.replace("\u2028", "\\u2028")  # what nobody sees is spelt out


def test_numbers_that_json_has_not_become_null(tmp_path: Path) -> None:
    write_page(page(data={"a": [1.0, math.nan, (math.inf, 2)], 3: None}), tmp_path / "p.html")
    assert data_of(read_page(tmp_path / "p.html")) == {"a": [1.0, None, [None, 2]], "3": None}
    assert plain({"x": (float("-inf"), "y")}) == {"x": [None, "y"]}


def test_long_pages_have_contents_and_folded_parts(tmp_path: Path) -> None:
    inner = Section("inner", items=["deep"], verdicts=[Verdict("ok", "fine")], code=["workbench x < y"])
    sections = [Section(f"S{i}", folded=i == 2, parts=[inner]) for i in range(5)]
    write_page(page(sections=sections), tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    assert [e.attributes["href"] for e in found.elements if e.tag == "a" and "href" in e.attributes] == [
        "#s1", "#s2", "#s3", "#s4", "#s5",
    ]  # fmt: skip
    assert sum(e.tag == "details" for e in found.elements) == 1
    assert sum(e.tag == "h3" for e in found.elements) == 5
    assert "workbench x < y" in [e.text for e in found.elements if e.tag == "pre"]


def test_several_pictures_fit_into_one_page(tmp_path: Path) -> None:
    block = saturation(0.5, 2.0)
    sections = [Section("S", figures=[(block.plot, 'one "quoted" <word>'), (block.plot, "two")])]
    write_page(page(sections=sections), tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    labels = [e.attributes["aria-label"] for e in found.elements if e.tag == "svg"]
    assert [e.text for e in found.elements if e.tag == "figcaption"] == ['one "quoted" <word>', "two"]
    assert labels == ["one  quoted   word ", "two"]


def test_images_that_are_alike_have_names_of_their_own(tmp_path: Path) -> None:
    def draw() -> Figure:
        figure = Figure((4.0, 2.0))
        for left in (0.0, 0.5):
            figure.add_axes((left, 0.0, 0.5, 1.0)).imshow([[0.0, 1.0], [1.0, 0.0]])
        return figure

    write_page(page(sections=[Section("S", figures=[(draw, "two squares")])]), tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    assert sum(e.tag == "image" for e in found.elements) == 2


@pytest.mark.parametrize("name", ["page.txt", "page", "page.png"])
def test_a_report_is_named_html(tmp_path: Path, name: str) -> None:
    with pytest.raises(wb.InputError, match=r"name it \.html"):
        saturation(2.0).report(tmp_path / name)
    assert not list(tmp_path.iterdir())
    assert SUFFIXES == (".html", ".htm")


def test_a_folder_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(wb.InputError, match="cannot be written: No such file"):
        write_page(page(), tmp_path / "none" / "p.html")


# -- how a result was made ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def step() -> wb.SimulationResult:
    with wb.load("fmu:Rudder", tolerance=1e-7, start_values={"bypass": 0.0}) as model:
        return wb.simulate(model, stop=0.2, inputs={"delC": wb.Step(time=0.1, value=5.0)}, outputs=["del"])


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_result_remembers_its_fmu_and_call(step: wb.SimulationResult, tmp_path: Path) -> None:
    step.report(tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    facts = facts_of_page(found)
    assert facts["SHA-256"] == sha256(locate("fmu:Rudder"))
    assert (facts["FMU"], facts["model"]) == ("Rudder.fmu", "Rudder")
    assert facts["generated by"] == "FMI workbench, FMI 2.0"
    assert facts["interface"] == "me (model exchange), solver gear, tolerance 1e-07"
    assert facts["set"] == "bypass = 0"
    assert "numpy" in facts["versions"]
    assert "control" in facts["versions"]
    own = {"command": "simulate", "model": "Rudder", "interface": "me", "solver": "gear", **step.to_dict()}
    assert {k: v for k, v in data_of(found).items() if k not in ("version", "seconds")} == plain(own)


def test_the_call_can_be_made_again(step: wb.SimulationResult, tmp_path: Path) -> None:
    origin = origin_of(step)
    assert origin is not None
    again: dict[str, Any] = {"wb": wb}
    exec(origin.call, again)  # noqa: S102 - it is what the report prints
    again["model"].close()
    np.testing.assert_array_equal(again["result"].signals["del"], step.signals["del"])


def test_what_cannot_be_written_is_named() -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        point = wb.trim(model).operating_point
        linear = wb.lin(model, at=point, outputs=["y"])
        response = wb.nfr(model, "u", "y", amplitudes=1.0, band=(0.5, 1.0), workers=wb.Workers(in_process=True))
    origins = [origin_of(x) for x in (linear, linear.result, response)]
    assert [o.call.splitlines()[1] for o in origins if o] == [
        "result = wb.lin(model, outputs=['y'], at=at)",
        "result = wb.lin(model, outputs=['y'], at=at)",
        "result = wb.nfr(model, 'u', 'y', amplitudes=1.0, band=(0.5, 1.0), workers=workers)",
    ]


def test_a_result_made_of_another_knows_the_fmu(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        data = wb.excite(
            model, "u", "y", samples=300, signal=wb.PrbsDesign(amplitude=1.0), dt=0.1, validation_samples=0
        )
    model_facts = [o.models for o in map(origin_of, (data, wb.identify(data.identification, order=1))) if o]
    assert [facts[0].fmus[0].sha256 for facts in model_facts] == [sha256(locate("fmu:FirstOrderLag"))] * 2
    data.identification.to_csv(tmp_path / "data.csv")
    found = wb.identify(tmp_path / "data.csv", inputs=["u"], outputs=["y"], order=1)
    origin = origin_of(found)
    assert origin is not None
    assert origin.files == {"data.csv": sha256(tmp_path / "data.csv")}


def test_a_system_lists_its_fmus(tmp_path: Path) -> None:
    parts = {"plant": "fmu:FirstOrderLag", "law": wb.FmuComponent(name="law", file="fmu:FirstOrderLag@3"), "k": -2.0}
    with wb.connect(
        parts, [("plant.y", "law.u"), ("k.y", "plant.u")], inputs={"r": "k.u"}, outputs=["plant.y"]
    ) as system:
        wb.lin(system).report(tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    cells = [e.text for e in found.elements if e.tag == "td"]
    assert sha256(locate("fmu:FirstOrderLag")) in cells
    assert sha256(locate("fmu:FirstOrderLag@3")) in cells
    assert {"plant", "law", "k", "gain: gain = -2.0"} <= set(cells)


def test_an_origin_goes_with_its_result() -> None:
    block = saturation(2.0)
    assert origin_of(block) is not None
    assert origin_of(replace(block, method="other")) is None
    gone = weakref.ref(block)
    del block
    gc.collect()
    assert gone() is None


def test_a_method_and_a_failure_leave_no_trace() -> None:
    @with_origin()
    def fail() -> wb.Advice:
        raise wb.InputError("no")

    with pytest.raises(wb.InputError, match="no"):
        fail()


def test_a_result_put_together_by_hand_has_a_page_too(step: wb.SimulationResult, tmp_path: Path) -> None:
    by_hand = replace(step)
    assert origin_of(by_hand) is None
    by_hand.report(tmp_path / "p.html")
    facts = facts_of_page(check_page_file(tmp_path / "p.html"))
    assert set(facts) == {"versions", "run", "held inputs", "operating point"}
    remember(by_hand, Origin(command="simulate", call="workbench simulate x.fmu"))
    by_hand.report(tmp_path / "p.html")
    assert facts_of_page(check_page_file(tmp_path / "p.html"))["command"] == "workbench simulate x.fmu"


def test_a_gone_fmu_costs_its_hash_only(tmp_path: Path) -> None:
    path = tmp_path / "lag.fmu"
    path.write_bytes(locate("fmu:FirstOrderLag").read_bytes())
    with wb.load(path) as model:
        path.unlink()
        result = wb.simulate(model, stop=1.0)
    result.report(tmp_path / "p.html")
    facts = facts_of_page(check_page_file(tmp_path / "p.html"))
    assert facts["FMU"] == "lag.fmu"
    assert "SHA-256" not in facts


# -- every kind of result -----------------------------------------------------------------------


def lag() -> wb.DescribedModel:
    return wb.load("fmu:FirstOrderLag")


def experiment() -> wb.Experiment:
    rng = np.random.default_rng(1)
    u = np.sign(rng.standard_normal(400))
    y = np.zeros(400)
    for k in range(399):
        y[k + 1] = 0.8 * y[k] + 0.2 * u[k] + 0.01 * rng.standard_normal()
    return wb.make_experiment(0.1, u, y, input_names=["u"], output_names=["y"])


@cache
def identified() -> wb.IdentifyResult:
    return wb.identify(experiment(), order=1)


def nyquist_of_lags() -> wb.NyquistResult:
    import control

    third = control.tf([8.0], [1.0, 1.0]) * control.tf([1.0], [1.0, 1.0]) * control.tf([1.0], [1.0, 1.0])
    return wb.nyquist(control.ss(third), wb.standard_block("saturation"))


def rate_limiter() -> wb.DescribingFunction:
    return wb.describing_function(wb.standard_block("rate_limiter"), [1.0, 4.0], [0.1, 1.0])


HERE = wb.Workers(in_process=True)
MADE: dict[str, Callable[[], Any]] = {
    "Advice": lambda: wb.advise(experiment()),
    "SpectralDensity": lambda: wb.sdf(experiment()),
    "Coherence": lambda: wb.coherence(experiment()),
    "SubspaceEstimate": lambda: wb.estimate(experiment().u, experiment().y, 0.1, order=2),
    "IdentifyResult": identified,
    "Validation": lambda: identified().validation,
    "ModelSpread": lambda: identified().uncertainty,
    "Overlay": lambda: wb.overlay(identified().model, lin=wb.lin(lag()).result),
    "DescribingFunction": rate_limiter,
    "NyquistResult": nyquist_of_lags,
    "LinearModel": lambda: wb.lin(lag()),
    "LinResult": lambda: wb.lin(lag()).result,
    "LinGrid": lambda: wb.lin_over(lag(), {"tau": [0.5, 2.0]}, workers=HERE),
    "LinComparison": lambda: wb.compare(lag(), "u", "y", frequencies=[0.1, 1.0], workers=HERE),
    "StepCheck": lambda: wb.step_check(lag(), wb.lin(lag()).result, input="u", output="y", height=1.0, stop=1.0),
    "TrimResult": lambda: wb.trim(lag(), u0={"u": 2.0}),
}


@pytest.mark.parametrize("name", MADE)
def test_every_kind_writes_its_page(name: str, tmp_path: Path) -> None:
    result = MADE[name]()
    assert type(result).__name__ == name
    result.report(tmp_path / "p.html")
    found = check_page_file(tmp_path / "p.html")
    data = data_of(found)
    assert {k: v for k, v in data.items() if k in result.to_dict()} == plain(result.to_dict())
    text = (tmp_path / "p.html").read_text(encoding="utf-8")
    assert "nan" not in [e.text.strip() for e in found.elements if e.tag == "td"]
    assert "<svg" in text or name == "SubspaceEstimate"
    assert repr(result).startswith(f"<{name}: {page_of(result).title}.")
    assert len(repr(result)) <= 202
    shown = result._repr_html_()  # as a notebook asks for it
    assert page_of(result).title in html.unescape(shown)
    assert ("<svg" in shown) == ("<svg" in text)


# -- evidence -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def changed() -> wb.NfrResult:
    return changed_lag()


def test_a_report_tells_what_differs_from_the_fmu(changed: wb.NfrResult, tmp_path: Path) -> None:
    changed.report(tmp_path / "p.html")
    facts = facts_of_page(read_page(tmp_path / "p.html"))
    assert facts["set"] == "tau = 2 (the FMU has 1)"
    assert "held inputs" not in facts  # the one input is forced
    assert facts["operating point"] == "u = 0; x = 0; t = 0 s"
    assert facts["chosen by auto"] == "interface: me (it has: me, cs), solver: gear"


def test_that_nothing_was_set_is_told_too(tmp_path: Path) -> None:
    with wb.load("fmu:FirstOrderLag") as model:
        wb.simulate(model, stop=1.0).report(tmp_path / "p.html")
    facts = facts_of_page(read_page(tmp_path / "p.html"))
    assert facts["set"] == "nothing: what is not varied here is as the file has it"
    assert facts["held inputs"] == "u = 0"


def test_what_auto_took_is_told_once(changed: wb.NfrResult, tmp_path: Path) -> None:
    changed.report(tmp_path / "p.html")
    text = re.sub(r"<script.*?</script>", "", (tmp_path / "p.html").read_text(encoding="utf-8"), flags=re.DOTALL)
    assert "chosen by auto; it has" not in text
    assert text.count("chosen by auto") == 1


def test_pictures_of_a_report_have_text_and_values(changed: wb.NfrResult, tmp_path: Path) -> None:
    changed.report(tmp_path / "p.html")
    found = read_page(tmp_path / "p.html")
    (picture,) = [e for e in found.elements if e.tag == "svg"]
    words = [e.text.strip() for e in found.elements if e.tag == "text"]
    assert "FirstOrderLag: u → y, amplitude 1" in words
    assert "frequency [Hz]" in words
    curves = json.loads(picture.attributes["data-points"])
    assert {c["y"] for c in curves} >= {"gain [dB]", "phase [deg]"}
    width, height = map(float, picture.attributes["viewbox"].split()[2:])
    gains = next(c for c in curves if c["y"] == "gain [dB]" and c["x"] == "frequency [Hz]")["points"]
    assert [p[2:] for p in gains] == [
        [pytest.approx(f), pytest.approx(g, rel=1e-4)]
        for f, g in zip(changed.frequency_hz, changed.gain_db[0], strict=True)
    ]
    assert all(0.0 < x < width and 0.0 < y < height for x, y, *_ in gains)


def test_tables_of_sentences_and_short_wide_ones_fold_and_long_ones_of_numbers_do_not() -> None:
    sentence = "coherence 0.99 in the middle, below 0.9 elsewhere"
    assert PageTable(("question", "verdict", "evidence"), [("noise", "good", sentence)]).folds
    assert not PageTable(("f", "gain", "phase"), [("1", "2", "3")]).folds
    assert not PageTable(("name", "text"), [("a", sentence)]).folds
    wide = ("1", "3.55036 ± 2e-05", "3.835636 ± 7e-06", "-0.10", "0.5")
    headings = ("amplitude [deg]", "−3 dB from 0.5 Hz [Hz]", "−90° [Hz]", "highest gain [dB]", "at [Hz]")
    assert PageTable(headings, [wide] * 6).folds
    assert not PageTable(headings, [wide] * 7).folds, "many rows of numbers are compared, one below the other"


def test_an_input_that_a_simulation_forces_is_not_among_those_held() -> None:
    with wb.load("fmu:Rudder") as model:
        found = wb.simulate(model, stop=0.1, inputs={"delC": wb.Step(time=0.05, value=2.0)}, outputs=["del"])
    told = point_facts(found.to_dict())
    assert "delC" not in told["held inputs"]
    assert told["operating point"].startswith("delC = 0 deg")
