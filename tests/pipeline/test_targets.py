"""A record's signal is kept with what was derived of it; another record's is not taken for it."""

from __future__ import annotations

from typing import Any

import numpy as np

from bayesdamp.pipeline.targets import KEPT, StudyRecord
from bayesdamp.store import CellResult

NONE: Any = None


def cell(name: str, key: str, height: float) -> CellResult:
    t = np.arange(20) / 10
    meta = {"quantity": "angle", "unit": "rad", "name": name, "step": 0.0, "provenance": {}}
    return CellResult(name, key, meta, {"t": t, "y": height * np.cos(t)})


def test_a_signal_is_one_for_one_cell_and_another_under_another_key() -> None:
    first = StudyRecord(NONE, NONE, cell("a", "one", 1.0)).signal
    assert StudyRecord(NONE, NONE, cell("a", "one", 1.0)).signal is first
    assert StudyRecord(NONE, NONE, cell("a", "two", 2.0)).signal.y[0] == 2.0
    assert StudyRecord(NONE, NONE, cell("b", "one", 3.0)).signal.y[0] == 3.0
    for i in range(KEPT):
        assert StudyRecord(NONE, NONE, cell("c", str(i), 4.0 + i)).signal.y[0] == 4.0 + i
    assert StudyRecord(NONE, NONE, cell("a", "one", 1.0)).signal is not first
