"""The benchmarks' page goes to reports/benchmarks, or where BENCH_OUT says; nowhere if that is empty."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import pytest

from tests.benchmarks.ledger import LEDGER, LOSS, write

OUT = Path(__file__).parents[2] / "reports" / "benchmarks"


_asked, _left = set[str](), Counter[str]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What is to be run, by file."""
    names = [item.path.name for item in items if item.path.parent == Path(__file__).parent]
    _asked.update(names)
    _left.update(names)


def pytest_runtest_logfinish(location: tuple[str, int | None, str]) -> None:
    """One of a file's tests has been run."""
    _left[Path(location[0]).name] -= 1


def pytest_sessionfinish(session: pytest.Session) -> None:
    out = os.environ.get("BENCH_OUT", str(OUT))
    if not out or not LEDGER.ratios:
        return
    every = sorted(path.name for path in Path(__file__).parent.glob("test_*.py"))
    lost = write(LEDGER, Path(out), sorted({f for f in _asked if not _left[f]}), every)
    print(f"\n{out}/README.md")
    for line in lost:
        print(f"lost more than {100 * LOSS:.0f} %: {line}")
