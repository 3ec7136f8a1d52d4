"""The progress bar: shown on a terminal, and only there."""

import io
import sys

import pytest

from twolink.io.progress import progress_bar


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("stream", "shown"), [(Terminal(), True), (io.StringIO(), False)])
def test_the_label_is_shown_on_a_terminal_only(
    stream: io.StringIO, shown: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "120")
    with progress_bar() as report:
        report(1.0, 4.0, "t = 1 s")
    assert ("t = 1 s  (Ctrl-C keeps what is done)" in stream.getvalue()) == shown
    for part in ("25%", "/s ", "left:"):
        assert (part in stream.getvalue()) == shown
    assert capsys.readouterr().out == ""
