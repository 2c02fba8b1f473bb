"""What is said when the console's process does not come up."""

import sys

import pytest

from labr_autonomy.console.process import ConsoleOptions, ConsoleProcess
from labr_autonomy.errors import LinkError


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("echo one >&2; echo 'no module of that name' >&2", "no module of that name"),
        ("exit 1", "without a word"),
    ],
)
def test_a_console_that_ends_at_once_is_an_error_with_its_own_last_words(
    tmp_path, monkeypatch, script, words
):
    python = tmp_path / "python"
    python.write_text(f"#!/bin/sh\n{script}\n")
    python.chmod(0o700)
    monkeypatch.setattr(sys, "executable", str(python))
    with pytest.raises(LinkError, match=f"ended before it was ready: {words}"):
        ConsoleProcess(ConsoleOptions(), pid=1, log_path=tmp_path / "log").__enter__()
