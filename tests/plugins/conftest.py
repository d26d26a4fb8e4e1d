"""Remove all plug-ins after each test."""

from collections.abc import Iterator

import pytest

from bayesdamp.plugins import use_modules


@pytest.fixture(autouse=True)
def _nothing_stays() -> Iterator[None]:
    yield
    use_modules(())
