"""The examples in the docstrings of the public interface print what they show; every entry point has one."""

import doctest
import inspect
from importlib import import_module

import pytest

import bayesdamp

ENTRY_POINTS = (
    "read", "signal", "simulate", "first_words", "Model", "estimate", "fit", "evidence", "compare", "Density",
)  # fmt: skip
MODULES = sorted({bayesdamp._HOME[name] for name in ENTRY_POINTS})


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_examples_print_what_they_show(name: str) -> None:
    results = doctest.testmod(import_module(name), raise_on_error=False)
    assert results.attempted > 0
    assert results.failed == 0


def test_every_entry_point_has_an_example() -> None:
    assert [n for n in ENTRY_POINTS if ">>> " not in (inspect.getdoc(getattr(bayesdamp, n)) or "")] == []
