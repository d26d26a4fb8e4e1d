# ruff: noqa: E501
"""Sampling rate, cycles, start and stop of measured decays."""

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.anomalies import find_anomalies
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.read import read_record

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.exists(), reason="the measured decays are not here")
RIG = {"time": "Time_Elapsed(s)", "value": "Angle(deg)"}
SWING = {"time": "Theta1.time", "value": "Theta1.signals.values"}
DISC = {"time": "Time (s) Run #1", "value": "Position (m) Run #1"}

# file, columns, unit, Hz (of the encoder after decimation), cycles, first and last sample at this rate (low, high)
TABLE = [
    ("horizontal_pendulum/60.txt", RIG, "deg", 259.5, (79, 83), (0, 60), (4300, 4570)),
    ("horizontal_pendulum/80P.txt", RIG, "deg", 259.6, (69, 74), (0, 100), (5000, 5600)),
    ("horizontal_pendulum/100.txt", RIG, "deg", 259.5, (103, 107), (190, 300), (9700, 10300)),
    ("ship_roll/model_test_21338.csv", {"time": "time", "value": "phi"}, "rad", 100.0, (72.5, 74), (800, 815), (19460, 19465)),
    ("encoder_pendulum/SingleDataFreeSwing_1_Dt_0_0001.mat", SWING, "rad", 123.46, (7, 7.6), (0, 20), (654, 716)),
    ("video_pendulum/lab1_data.txt", {"time": 1, "value": 2}, "rad", 20.0, (70, 71.5), (0, 0), (2328, 2330)),
    # the hand still acts in the first swing: from 136° it ends at 99°, a free one would reach 118°
    ("rotary_pendulum/pendulum_free_swing_data_01.txt", {"rate": 1000.0}, "deg", 1000.0, (6.7, 8.1), (240, 730), (4999, 4999)),
    # the disc's amplitude falls below two steps of its 1 cm
    ("spring_disc/molla_dura_discopieno_0.1223kg.csv", DISC, "m", 100.0, (40, 65), (30, 130), (3500, 5400)),
]  # fmt: skip


@pytest.mark.parametrize(("file", "columns", "unit", "rate", "cycles", "start", "stop"), TABLE)
def test_a_measured_record_is_cleaned_as_expected(file, columns, unit, rate, cycles, start, stop):
    raw = read_record(DATA / file, **columns)
    signal = clean(raw, name="x", unit=unit)
    mean = (signal.t.size - 1) / signal.t[-1]
    assert mean == pytest.approx(rate, rel=1e-3)
    assert cycles[0] <= features(signal).cycles <= cycles[1]
    begin = 0.0 if raw.t is None else raw.t[0]
    assert start[0] <= (signal.provenance.start - begin) * mean <= start[1]
    assert stop[0] <= (signal.provenance.stop - begin) * mean <= stop[1]
    assert signal.t[0] == 0.0
    assert np.all(np.diff(signal.t) > 0)


# Read by eye, in s: the turning point at which the hand releases it, the last clear peak, and the begin of rest.
BY_EYE = [
    (1.1, 8.6, 9.7), (0.8, 7.0, 8.6), (0.7, 7.6, 8.7), (1.05, 8.0, 9.6), (0.65, 6.8, 8.2), (0.8, 7.1, 8.3),
    (1.8, 12.2, 13.2), (1.0, 11.9, 13.5), (1.05, 12.8, 14.3), (1.4, 12.5, 13.6),
]  # fmt: skip


@pytest.mark.parametrize(("run", "by_eye"), list(enumerate(BY_EYE, start=1)))
def test_ten_runs_are_cut_as_by_eye(run, by_eye):
    """A decay starts at the release or half a swing later, and stops before the body sticks away from zero."""
    released, last_peak, rests = by_eye
    columns = {"time": f"Time (s) Run #{run}", "value": f"Angle, Ch 1+2 (rad) Run #{run}"}
    signal = clean(read_record(DATA / "ten_runs/Run_1-10_no_magnet.csv", **columns), name="x")
    assert released - 0.06 <= signal.provenance.start <= released + 0.75
    assert last_peak - 0.1 <= signal.provenance.stop <= rests
    assert len(signal.provenance.decays) == 1
    assert find_anomalies(signal, features(signal)) == ()
