"""The shipped table of evidences: on records whose friction touches zero, three methods agree.

`make reports ARGS=evidence_audit` writes the table.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.inference.evidence import audit
from validation.rows import read_rows

pytestmark = pytest.mark.slow

FILE = Path(__file__).resolve().parents[3] / "reports" / "evidence_audit" / "touching_zero.csv"


def agrees(z: np.ndarray) -> bool:
    """Return whether no score is beyond 4.5 (false alarm 8e-5 for twelve) and the mean is within 4 errors (6e-5)."""
    return bool(np.abs(z).max() < 4.5 and abs(z.mean()) < 4 / np.sqrt(z.size))


def test_the_friction_of_the_records_touches_zero():
    result = read_rows(FILE)
    assert len(result) >= audit.CASES
    assert result["touching"].median() < 1
    assert result["touching"].max() < 4
    assert (result["nested_outcome"] == "ok").all()


@pytest.mark.parametrize("method", ["importance", "bridge"])
def test_nested_sampling_agrees_with(method):
    """Negative control: without the reflection at zero, of log 2, it would not."""
    away, sd = audit.differences(read_rows(FILE), method)
    assert agrees(away / sd)
    assert not agrees((away - np.log(2)) / sd)
