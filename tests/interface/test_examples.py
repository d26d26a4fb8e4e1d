"""The examples in docstrings of the public interface give what they show; every entry point has one."""

from __future__ import annotations

import doctest
import inspect
from importlib import import_module

import pytest

import bayesdamp

MODULES = sorted(
    {
        "bayesdamp.interface.comparison",
        "bayesdamp.interface.density",
        "bayesdamp.interface.estimate",
        "bayesdamp.interface.evidence",
        "bayesdamp.interface.fit",
        "bayesdamp.interface.model",
        "bayesdamp.interface.record",
        "bayesdamp.interface.signal",
        "bayesdamp.interface.simulate",
        "bayesdamp.records.oscillation.first_look",
    }
)
SHOWN = (
    "read",
    "signal",
    "simulate",
    "first_words",
    "Model",
    "estimate",
    "fit",
    "evidence",
    "compare",
    "Density",
)


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_examples_of(name: str) -> None:
    done = doctest.testmod(import_module(name), raise_on_error=False)
    assert done.attempted > 0
    assert done.failed == 0


def test_every_entry_point_has_an_example() -> None:
    assert [n for n in SHOWN if ">>> " not in (inspect.getdoc(getattr(bayesdamp, n)) or "")] == []


def test_a_wrong_example_is_seen() -> None:
    def wrong() -> None:
        """
        >>> 1 + 1
        3
        """

    finder = doctest.DocTestFinder().find(wrong, "wrong")
    runner = doctest.DocTestRunner(verbose=False)
    result = runner.run(finder[0], out=lambda _: None)
    assert result.failed == 1
