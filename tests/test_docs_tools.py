"""What the documentation is tested with: examples are run and compared."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.tools.comparison import difference
from docs.tools.examples import ExampleError, blocks_of, compare, run_page, with_shown
from docs.tools.update import main as update


@pytest.mark.parametrize(
    ("page", "shown"),
    [
        ("gain 0.5012\n", "gain 0.5013"),
        ("gain   0.5012  \n\n", "\n gain 0.5012"),
        ("a 1.2e-9 b", "a -3e-16 b"),
        ("─────── \nx 1", "────\nx 1"),
        ("pole -1.30", "pole −1.31"),
        ("first\n…\nlast 3", "first\nmany\nlines\nlast 3"),
        ("…\nlast", "any\nlast"),
        ("first\n…", "first\n"),
        ("verdict yes, …", "verdict yes, at most 3.1 dB"),
        ("80 Hz", "81 Hz"),
    ],
)
def test_what_agrees(page: str, shown: str) -> None:
    assert not difference(page, shown)


@pytest.mark.parametrize(
    ("page", "shown"),
    [
        ("gain 0.5012", "gain 0.5018"),
        ("gain 0.5012", "gain 0.5012 dB"),
        ("3 poles", "4 poles"),
        ("stable yes", "stable no"),
        ("one", "one\ntwo"),
        ("one\ntwo", "one"),
        ("first\n…\nlast", "first\nlast\nmore"),
        ("first\n…\nlast", "second\nlast"),
        ("verdict yes, …", "verdict no, at most 3.1 dB"),
    ],
)
def test_what_differs(page: str, shown: str) -> None:
    assert difference(page, shown)


PAGE = """
```toml title="a.txt"
text
```

```python
from pathlib import Path
print(Path("a.txt").read_text().strip(), 1.25)
```

```text
text 1.5
```

```sh
workbench info nothing.fmu
echo $?
```

```text
…
2
```
"""


def test_a_page_is_run_and_compared(tmp_path: Path) -> None:
    shown = run_page(PAGE, tmp_path)
    assert [b.language for b in blocks_of(PAGE)] == ["toml", "python", "text", "sh", "text"]
    assert [one.text.strip().splitlines()[-1] for one in shown] == ["text 1.25", "2"]
    words = list(compare(shown))
    assert len(words) == 1
    assert "text 1.5" in words[0]
    better = with_shown(PAGE, shown)
    assert "text 1.25" in better
    assert "…\n2" in better  # what the author cut stays
    assert list(compare(run_page(better, tmp_path))) == []


@pytest.mark.parametrize("command", ["rm -rf nothing", "workbench info nothing.fmu"])
def test_what_cannot_be_run_or_fails_unseen_is_an_error(command: str, tmp_path: Path) -> None:
    with pytest.raises(ExampleError):
        run_page(f"```sh\n{command}\n```\n", tmp_path)


def test_a_page_that_does_not_exist_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert update(["trm.md"]) == 2
    said = capsys.readouterr().err
    assert said.endswith("trm.md: no such page; did you mean docs/methods/trim.md?\n")
    assert said.count("\n") == 1


def test_a_difference_between_gaps_is_told_by_its_own_line() -> None:
    shown = "a 1\nb 22.5\nc 3\nd 4"
    assert difference("a 1\nb 23.5\n…", shown) == "the page has 'b 23.5', shown was 'b 22.5'"
    assert difference("…\nc 3\nd 5", shown) == "the page has 'd 5', shown was 'd 4'"
    assert difference("…\nd 4\ne 5", shown) == "the page has 'e 5', shown was None"
    assert difference("…\nx", shown) == "the page has 'x', shown was 'a 1' (or below)"
