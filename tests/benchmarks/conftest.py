"""The benchmarks' page goes to reports/benchmarks, or where BENCH_OUT says; nowhere if that is empty."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.benchmarks.ledger import LEDGER, LOSS, write

OUT = Path(__file__).parents[2] / "reports" / "benchmarks"


def pytest_sessionfinish(session: pytest.Session) -> None:
    out = os.environ.get("BENCH_OUT", str(OUT))
    if not out or not LEDGER.ratios:
        return
    lost = write(LEDGER, Path(out))
    print(f"\n{out}/README.md")
    for line in lost:
        print(f"lost more than {100 * LOSS:.0f} %: {line}")
