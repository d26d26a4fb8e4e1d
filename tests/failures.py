"""Tables of cases in one test: all that fail are reported at once, each with its name."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from types import TracebackType

import pytest


class Failures:
    """What fails within `of`; the test fails with all of it at the end."""

    def __init__(self) -> None:
        self.found: list[str] = []

    @contextlib.contextmanager
    def of(self, name: object) -> Iterator[None]:
        """Keep what fails here under the case's name, and go on."""
        try:
            yield
        except (Exception, pytest.fail.Exception) as error:
            self.found.append(f"{name}: {type(error).__name__}: {error}")

    def __enter__(self) -> Failures:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: BaseException | TracebackType | None) -> None:
        if kind is None:
            assert not self.found, "\n".join(self.found)
