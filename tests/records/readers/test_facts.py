"""Rates that stand in a file's head, as people write numbers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.files.facts import doubtful_rate, sampling_rate
from bayesdamp.records.read import read_record
from bayesdamp.types import InputError

Y = 0.3 * np.exp(-0.002 * np.arange(400)) * np.cos(0.12 * np.arange(400))

RATES = {
    "sample rate: 50 Hz": 50.0, "Abtastrate: 50,0 Hz": 50.0, "Abtastrate = 50,25 Hz": 50.25,
    "sample rate: 1,234,567 Hz": 1234567.0, "sample rate: 50,000.5 Hz": 50000.5, "fs: 0,050 kHz": 50.0,
    "dt: 0,020 s": 50.0, "Abtastintervall: 20,0 ms": 50.0, "sample rate: 50000 Hz": 50000.0, "fs: 50,0000": 50.0,
}  # fmt: skip


def one_column(path: Path, head: str) -> Path:
    path.write_text("\n".join([f"# {head}", "angle", *map(str, Y.tolist())]), encoding="utf-8")
    return path


@pytest.mark.parametrize("head", RATES)
def test_a_rate_in_the_head_is_read(tmp_path: Path, head: str) -> None:
    raw = read_record(one_column(tmp_path / "a.csv", head))
    assert raw.rate == pytest.approx(RATES[head], rel=1e-12)


@pytest.mark.parametrize(
    ("head", "either"),
    [
        ("sample rate: 50,000 Hz", "50 or 50000 Hz"),
        ("fs = 1,000", "1 or 1000 Hz"),
        ("dt: 20,000 us", "50000 or 50 Hz"),
    ],
)
def test_a_comma_that_may_mean_two_things_is_asked_about(tmp_path: Path, head: str, either: str) -> None:
    path = one_column(tmp_path / "a.csv", head)
    with pytest.raises(InputError, match=f"which may be {either}: give the rate") as caught:
        read_record(path)
    assert caught.value.arguments == ("rate",)
    assert len(str(caught.value)) < 300
    raw = read_record(path, rate=50.0)
    assert raw.rate == 50.0
    assert sampling_rate(raw.provenance.facts) is None
    assert doubtful_rate(raw.provenance.facts) is not None
