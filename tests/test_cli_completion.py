"""Completion in a shell: commands, and the options of the command that is being written."""

from __future__ import annotations

import pytest

from workbench.cli.app import run


def completed(words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    monkeypatch.setenv("_WORKBENCH_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert run([]) == 0
    return capsys.readouterr().out.split()


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("workbench n", {"nfr"}),
        ("workbench nfr --amp", {"--amplitude"}),
        ("workbench nfr fmu:Rudder --in", {"--input", "--interface", "--in-process"}),
        ("workbench feed", {"feedback", "feed-forward"}),
    ],
)
def test_words_are_completed(
    words: str, found: set[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert set(completed(words, monkeypatch, capsys)) == found


def test_the_script_for_a_shell_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--show-completion", "bash"]) == 0
    assert "_WORKBENCH_COMPLETE" in capsys.readouterr().out
