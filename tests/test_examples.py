"""The notebooks in `examples/`: each runs from its first cell to its last, where what it says is asserted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[1] / "examples").glob("*.ipynb"))


def test_there_is_a_notebook_for_each_use() -> None:
    uses = ["foreign_fmu", "actuator_specification", "jump_resonance", "identification", "failed_aileron"]
    assert [path.stem.partition("_")[2] for path in EXAMPLES] == uses


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_a_notebook_runs_to_its_end(path: Path, tmp_path: Path) -> None:
    import nbformat  # a second to import, for all that only collect
    from nbclient import NotebookClient

    book = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    assert book.cells[0].cell_type == "markdown"
    assert "assert " in book.cells[-1].source
    NotebookClient(book, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [out for cell in book.cells for out in cell.get("outputs", []) if "data" in out]
    assert any("text/html" in out["data"] or "image/png" in out["data"] for out in shown)
    assert all(len(out["data"].get("text/plain", "")) < 300 for out in shown)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_a_notebook_is_committed_without_results(path: Path) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    assert cells
    assert not any(cell.get("outputs") or cell.get("execution_count") for cell in cells)
