"""What a run reads again, and after which task another one comes."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.config import Recording
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.pipeline.jobs import _task_group_of
from bayesdamp.pipeline.records import read_free_decay


def test_a_file_that_is_replaced_with_the_same_time_stamp_is_read_again(tmp_path: Path) -> None:
    """Control: the same file is not read a second time."""
    t, file = np.arange(400) / 40, tmp_path / "rig.csv"
    recording = Recording(file=file.name, path=file)

    def read(size: float) -> tuple[float, object]:
        new = tmp_path / "new.csv"
        np.savetxt(
            new, np.column_stack([t, size * np.exp(-0.05 * t) * np.cos(6 * t)]), delimiter=",", fmt="%.6f"
        )
        os.utime(new, (1e9, 1e9))
        new.replace(file)
        signal = read_free_decay(recording, "rig")[1]
        return float(np.max(signal.y)), signal

    (first, _), (second, signal) = read(0.2), read(0.3)
    assert second == pytest.approx(1.5 * first, rel=1e-3)
    assert read_free_decay(recording, "rig")[1] is signal


def test_evidence_that_needs_draws_comes_after_the_samplers(monkeypatch: pytest.MonkeyPatch) -> None:
    name = "evidence/rig/0/viscous/importance"
    assert _task_group_of(name) == "evidence"
    monkeypatch.setattr(type(EVIDENCES.get("importance")), "needs_draws", True)
    assert _task_group_of(name) == "sample"
