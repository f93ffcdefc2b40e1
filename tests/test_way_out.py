"""Model exchange is advised where the FMU offers it, and nowhere else."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import workbench as wb
from workbench.core.machine.files import pack
from workbench.fmi.archive import locate

LAG = "fmu:FirstOrderLag"
ASKED: dict[str, Callable[[wb.Model], object]] = {
    "open_point": lambda m: m.open_point(),
    "jump": lambda m: m.open_session().jump(None),  # type: ignore[attr-defined]
    "lin": lambda m: wb.lin(m, method="exact"),
    "branches": lambda m: wb.branches(m, "u", "y", amplitudes=[1.0], band=(0.1, 1.0)),
    "modes": lambda m: wb.modes(m, vary="tau", values=[0.5, 1.0, 2.0]),
}


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an FMU that offers co-simulation alone."""
    with zipfile.ZipFile(locate(LAG)) as archive:
        files = {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}
    text = files["modelDescription.xml"].decode()
    files["modelDescription.xml"] = re.sub(r"<ModelExchange\b.*?</ModelExchange>", "", text, flags=re.DOTALL).encode()
    path = tmp_path_factory.mktemp("alone") / "Alone.fmu"
    pack(path, files)
    return path


@pytest.mark.parametrize("name", ASKED)
def test_model_exchange_is_advised_where_it_is_offered(name: str, alone: Path) -> None:
    for path, offered in ((LAG, True), (str(alone), False)):
        with wb.load(path, interface="cs") as model, pytest.raises(wb.InputError) as caught:
            ASKED[name](model)
        told = str(caught.value)
        assert ("use interface me" in told) == offered, told
        assert offered or re.search("export it for model exchange|method response|use nfr", told), told
        assert "\n" not in told


def test_components_of_a_system_are_named(alone: Path) -> None:
    for path, words in ((LAG, 'give interface "me" to a'), (str(alone), "the FMU of a offers no other interface")):
        parts = {"a": wb.FmuComponent(name="a", file=path, interface="cs")}
        with wb.connect(parts, inputs={"u": "a.u"}, outputs={"y": "a.y"}, step=0.1) as system:
            assert system.interface == "cs"
            with pytest.raises(wb.InputError, match=words):
                system.open_point()


def test_a_short_step_is_advised_beside_it(alone: Path) -> None:
    def told(path: str) -> Iterator[str]:
        with wb.load(path, interface="cs") as model:
            yield model.way_out("use a step below 0.1 s")

    assert list(told(LAG)) == ["use interface me, or a step below 0.1 s"]
    assert list(told(str(alone))) == ["use a step below 0.1 s"]
