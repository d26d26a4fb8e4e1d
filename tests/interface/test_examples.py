"""The examples in docstrings of the public interface give what they show; every entry point has one."""

from __future__ import annotations

import doctest
import inspect
from importlib import import_module

import pytest

import bayesdamp

SHOWN = (
    "read", "signal", "simulate", "first_words", "Model", "estimate", "fit", "evidence", "compare", "Density",
)  # fmt: skip


MODULES = sorted({bayesdamp._HOME[name] for name in SHOWN})


@pytest.mark.slow
@pytest.mark.parametrize("name", MODULES)
def test_examples_of(name: str) -> None:
    done = doctest.testmod(import_module(name), raise_on_error=False)
    assert done.attempted > 0
    assert done.failed == 0


def test_every_entry_point_has_an_example() -> None:
    assert [n for n in SHOWN if ">>> " not in (inspect.getdoc(getattr(bayesdamp, n)) or "")] == []
