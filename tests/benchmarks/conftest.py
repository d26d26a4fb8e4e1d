"""The benchmarks' page goes to reports/benchmarks, or where BENCH_OUT says; nowhere if that is empty. It is written
after each file of tests: of a run that is cut off, what was measured stays."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from tests.benchmarks.ledger import LEDGER, LOSS, before, write

OUT = Path(__file__).parents[2] / "reports" / "benchmarks"


_asked, _left = set[str](), Counter[str]()
_earlier: dict[str, float] = {}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is to be run, by file."""
    names = [item.path.name for item in items if item.path.parent == Path(__file__).parent]
    if out := _out():
        _earlier.update(before(out))
    _asked.update(names)
    _left.update(names)


def pytest_runtest_logfinish(location: tuple[str, int | None, str]) -> None:
    """One of a file's tests has been run."""
    name = Path(location[0]).name
    _left[name] -= 1
    if not _left[name]:
        _written()


def pytest_sessionfinish() -> None:
    lost = _written()
    if lost is None:
        return
    print(f"\n{_out()}/README.md")
    for line in lost:
        print(f"lost more than {100 * LOSS:.0f} %: {line}")


def _out() -> Path | None:
    said = os.environ.get("BENCH_OUT", str(OUT))
    return Path(said) if said else None


def _written() -> list[str] | None:
    """What was lost against the run before; None where nothing was measured, or is to be written."""
    out = _out()
    if out is None or not LEDGER.ratios:
        return None
    every = sorted(path.name for path in Path(__file__).parent.glob("test_*.py"))
    return write(LEDGER, out, sorted({f for f in _asked if not _left[f]}), every, _earlier)
