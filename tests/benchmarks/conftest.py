"""Write the page of the benchmarks after a run: to reports/benchmarks, or to BENCH_OUT, or nowhere if that is empty."""

import os
from pathlib import Path

from tests.benchmarks.page import MEASURED, write_page

FOLDER = Path(__file__).parents[2] / "reports" / "benchmarks"


def pytest_sessionfinish() -> None:
    folder = os.environ.get("BENCH_OUT", str(FOLDER))
    if folder and MEASURED:
        write_page(MEASURED, Path(folder))
