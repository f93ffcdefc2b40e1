"""Completion in a shell: commands, and the options of the command that is being written."""

from __future__ import annotations

import pytest

from workbench.cli.app import run


def completed(words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> list[str]:
    monkeypatch.setenv("_WORKBENCH_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    with pytest.raises(SystemExit) as ended:  # by typer
        run([])
    assert not ended.value.code
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


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_the_shell_that_asks_is_shown(
    shell: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("shellingham.detect_shell", lambda: (shell, shell))  # who runs the tests may have none
    with pytest.raises(SystemExit) as ended:
        run(["--show-completion"])
    assert not ended.value.code
    shown = capsys.readouterr().out
    assert "_WORKBENCH_COMPLETE" in shown
    assert f"complete_{shell}" in shown
