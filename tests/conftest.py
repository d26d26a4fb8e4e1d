"""What holds for all tests."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _nothing_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run inside a test's own process leaves no traced programs: they may be of code that a test has replaced."""
    monkeypatch.setattr("bayesdamp.pipeline.workers.keep_in", lambda _: None)
