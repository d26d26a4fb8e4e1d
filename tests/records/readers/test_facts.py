"""Sampling rates in the head of a file, in the ways in which people and instruments write them."""

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.files.contents import sampling_rate
from bayesdamp.records.read import read_record
from bayesdamp.types import InputError
from tests.records.tables import write_table

Y = 0.3 * np.exp(-0.002 * np.arange(400)) * np.cos(0.12 * np.arange(400))

RATES = {
    "sample rate: 50 Hz": 50.0, "Abtastrate: 50,0 Hz": 50.0, "Abtastrate = 50,25 Hz": 50.25,
    "sample rate: 1,234,567 Hz": 1234567.0, "sample rate: 50,000.5 Hz": 50000.5, "fs: 0,050 kHz": 50.0,
    "Sample rate (mHz): 500": 0.5, "Sample rate (MHz): 500": 5e8, "fs: 50 MHZ": 5e7, "fs: 50 Khz": 5e4,
    "dt: 0,020 s": 50.0, "Abtastintervall: 20,0 ms": 50.0, "sample rate: 50000 Hz": 50000.0, "fs: 50,0000": 50.0,
}  # fmt: skip


def one_column(path: Path, head: str) -> Path:
    """Write one column below a comment; a head of two lines is a table of its own."""
    return write_table(path, head if "\n" in head else f"# {head}\nangle", Y)


NAMES = (
    "sampling rate: 50 Hz, range: 2 g", "Rate [Hz]: 50", "samples_per_sec = 50", "data rate: 50 samples/s", "sr = 50",
    "dt_ms: 20", "Sampling period (ms): 20", "Log interval: 20 ms", "XIncrement: 0.02", "Ts = 0.02",
    "Sample Interval,20e-3,s", "dt,20000 µs", "Horizontal.Sample interval (ms): 20", "Sampling freq. (Hz): 50",
    "start_deg, sample_rate, duration\n90, 50, 5", "Sampling Rate,50 Sa/s", "ODR,50 Hz",
)  # fmt: skip


@pytest.mark.parametrize(("head", "rate"), (RATES | dict.fromkeys(NAMES, 50.0)).items())
def test_a_rate_in_the_head_is_read(tmp_path: Path, head: str, rate: float) -> None:
    assert read_record(one_column(tmp_path / "a.csv", head)).rate == pytest.approx(rate, rel=1e-12)


@pytest.mark.parametrize("head", ["sample rate: 50,000 Hz", "fs = 1,000", "dt: 20,000 us", "fs: 50 mhz"])
def test_a_comma_or_a_unit_with_two_meanings_gives_no_rate(tmp_path: Path, head: str) -> None:
    path = one_column(tmp_path / "a.csv", head)
    with pytest.raises(InputError, match="or give the rate in Hz") as caught:
        read_record(path)
    assert caught.value.arguments == ("rate",)
    raw = read_record(path, rate=50.0)
    assert raw.rate == 50.0
    assert sampling_rate(raw.provenance.facts) is None


def test_other_rates_are_not_sampling_rates() -> None:
    """Negative control: frequency and period of the oscillation, a time stamp, and the clock of a processor."""
    for head in ("frequency: 50 Hz", "ts: 0.02", "clock rate: 50", "period: 0.02", "sample_rate: fast"):
        name, _, value = head.partition(": ")
        assert sampling_rate({name: value}) is None


HEADS = {
    "times": ("waveform,CH1\nt0,2024-01-01 00:00:00\ndelta t,2E-2\ntime,Y", True),
    "times without names": ("t0,2024-01-01 00:00:00\ndelta t,2E-2\n", True),
    "no times": ("waveform,CH1\nt0,2024-01-01 00:00:00\ndelta t,2E-2\nY", False),
    "no times and no names": ("t0,0\ndelta t,2E-2", False),
}


@pytest.mark.parametrize(("head", "timed"), HEADS.values(), ids=HEADS)
def test_a_waveform_exported_by_labview_is_read(tmp_path: Path, head: str, timed: bool) -> None:
    t = np.arange(400) / 50
    raw = read_record(write_table(tmp_path / "a.csv", head, *([t, Y] if timed else [Y])))
    np.testing.assert_array_equal(raw.y, Y)
    stated, other = (raw.t, raw.rate) if timed else (raw.rate, raw.t)
    assert stated == pytest.approx(t if timed else 50.0)
    assert other is None
