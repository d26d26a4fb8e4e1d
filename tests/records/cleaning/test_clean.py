"""Clocks and windows of records made by hand, for which all of it is known."""

from itertools import pairwise

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean, recording_step
from bayesdamp.records.cleaning.clock import clock_times
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError


def record(t, y, rate=None):
    return RawRecord(t, np.asarray(y, float), rate, np.arange(len(y)))


def decay(t, zeta=0.3, w=9.0):
    return np.where(t < 0, 0.5, 0.5 * np.exp(-zeta * t) * np.cos(w * t)) + 0.1


def bursts(seed=0):
    """Return a record and its step: held for 1.5 s, then released; stamps from 100 s on, in bursts of 10 to 20."""
    rng = np.random.default_rng(seed)
    step = 0.004
    index = np.arange(2500)
    y = decay(step * index - 1.5) + 0.001 * rng.standard_normal(index.size)
    ends = np.cumsum(rng.integers(10, 21, 400))
    stamp = 100 + step * ends[np.searchsorted(ends, index, side="right")]
    return record(np.round(stamp, 3), y), step


def test_a_clock_in_bursts_is_rebuilt_and_the_release_is_the_start():
    raw, step = bursts()
    signal = clean(raw, name="x")
    assert (signal.uniform, signal.t[0]) == (True, 0.0)
    assert signal.t[1] == pytest.approx(step, rel=1e-3)
    # from the release (sample 375) to a turning point within a period (175 samples) of it
    assert 365 <= (signal.provenance.start - raw.t[0]) / step <= 375 + 180
    assert any("burst" in note for note in signal.provenance.notes)


@pytest.mark.parametrize("rate", [1.5, 1.7])
def test_a_body_may_be_held_before_it_is_released_and_heavily_damped(rate):
    t = np.arange(1000) * 0.005 - 1.75
    y = decay(t, rate) + 0.001 * np.random.default_rng(1).standard_normal(t.size)
    assert features(clean(record(t, y), name="x")).period == pytest.approx(2 * np.pi / 9, rel=0.03)


@pytest.mark.parametrize(("ratio", "before"), [(0.27, 2.0), (0.27, 0.0), (0.3, 0.0)])
def test_a_decay_of_three_cycles_is_used(ratio, before):
    """In closed form, with a period of 1 s; the body is held for `before` s."""
    t, wd = np.arange(0, 8, 0.01) - before, 2 * np.pi * np.sqrt(1 - ratio**2)
    fall = np.exp(-2 * np.pi * ratio * t) * (np.cos(wd * t) + 2 * np.pi * ratio / wd * np.sin(wd * t))
    y = np.where(t < 0, 1.0, fall) + 0.001 * np.random.default_rng(1).standard_normal(t.size)
    assert features(clean(record(t, y), name="x")).cycles > 2.9


def test_a_given_window_is_in_seconds_of_the_file():
    t = 50 + np.arange(2000) * 0.01
    signal = clean(record(t, decay(t - 50, 0.1)), name="x", start=52.0, stop=60.0)
    window = (signal.provenance.start, signal.provenance.stop, signal.t[-1])
    assert window == pytest.approx((52.0, 60.0, 8.0))
    assert signal.t.size == 801


def test_an_angle_in_rad_that_swings_beyond_half_a_turn_gives_a_warning():
    """It may be in degrees. Negative control: other units, and a smaller swing."""
    t = np.arange(1000) * 0.01
    counts = []
    for size, unit in ((30.0, "rad"), (30.0, "deg"), (30.0, "m"), (2.0, "rad"), (30.0, "V")):
        warnings = map(str, clean(record(t, size * decay(t)), name="x", unit=unit).provenance.warnings)
        counts.append(sum(w.startswith("it swings by") and "give the unit" in w for w in warnings))
    assert counts == [1, 0, 0, 0, 0]


def test_outliers_are_not_removed():
    t = np.arange(2000) * 0.01
    y = decay(t, 0.1) + 0.002 * np.random.default_rng(0).standard_normal(t.size)
    y[[300, 700, 1100, 1500]] += 0.2
    np.testing.assert_array_equal(clean(record(t, y), name="x").y, y)


def test_two_cycles_are_enough_and_one_is_not():
    t = np.linspace(0, 2.2 * 2 * np.pi / 9, 400)
    assert features(clean(record(t, decay(t)), name="x")).cycles == pytest.approx(2.2, abs=0.05)
    with pytest.raises(InputError, match=r"x: has 1\.1 periods of free decay; at least two are needed"):
        clean(record(t / 2, decay(t / 2)), name="x")


T = np.arange(1000) * 0.01
SWAPPED = T.copy()
SWAPPED[[400, 401]] = SWAPPED[[401, 400]]
TWICE = T.copy()
TWICE[400] = TWICE[399]
PAUSE = np.floor(T / 0.1) * 0.1 + np.where(T > 5, 30.0, 0.0)
BAD = {
    "backwards, uniform": (SWAPPED, {"clock": "uniform"}, "goes back"),
    "one repeated": (TWICE, {}, "repeats"),
    "bursts as logged": (np.floor(T / 0.1) * 0.1, {"clock": "as_logged"}, "cannot use"),
    "pause between bursts": (PAUSE, {}, "pause"),
    "one time": (np.zeros(1000), {}, "all times are 0"),
    "start": (T, {"start": 11.0}, "start = 11 s is outside the record"),
    "word": (T, {"stop": "end"}, "stop must be"),
    "short": (T, {"start": 5.0, "stop": 5.05}, "at least 10"),
}


@pytest.mark.parametrize(("t", "options", "message"), BAD.values(), ids=BAD)
def test_an_impossible_clock_or_option_is_refused(t, options, message):
    with pytest.raises(InputError, match=rf"^rig[^\n]*{message}[^\n]*$"):
        clean(record(t, decay(T)), name="rig", **options)


def test_no_oscillation_is_refused():
    """Noise, a shuffled record, an exponential, a trend, five levels, and too few samples in a cycle."""
    rng, levels = np.random.default_rng(0), np.round(2 * np.exp(-T / 50) * np.cos(9 * T))
    for y in (rng.standard_normal(1000), rng.permutation(decay(T)), np.exp(-T), T, levels):
        with pytest.raises(InputError, match=r"oscillation|periods|has only 5 different values"):
            clean(record(T, y), name="x")
    t = np.arange(0, 60, 0.31)
    coarse = decay(t, 0.04, 2 * np.pi * 1.1) + 0.002 * rng.standard_normal(t.size)
    with pytest.raises(InputError, match=r"its strongest oscillation, at 1\.1 Hz, has 2\.9 samples a cycle"):
        clean(record(t, coarse), name="x")


def test_the_step_of_a_rounded_record_is_recognised():
    y = decay(T)
    assert recording_step(np.round(y / 0.013) * 0.013) == pytest.approx(0.013, rel=1e-6)
    assert recording_step(np.round(np.round(y / 0.013) * 0.013, 3)) == pytest.approx(0.013, rel=1e-2)
    assert recording_step(y) == 0.0
    assert recording_step(np.random.default_rng(0).standard_normal(2000)) == 0.0


COUNTS_DOWN = "runs backwards throughout, from 8 to 0.02 s.*give the rate \\(50 Hz\\) instead"


def test_times_that_go_back_are_refused_with_what_to_do():
    """Sorting is suggested only if it gives even sampling: it would turn a clock that counts down into growth."""
    i = np.arange(400)
    for t, message, arguments in (
        (8 - i / 50, COUNTS_DOWN, ("rate",)),
        (np.r_[i[:10][::-1], i[10:]] / 50, r"\(9 rows do so\).*sort them by time", ()),
        (np.r_[(i[:40] - 20) * 50.0, i[20:380] * 0.05], "does another record begin there", ("time", "rate")),
        (np.r_[i[:200], i[:200]] / 50, "does another record begin there", ("time", "rate")),
    ):
        with pytest.raises(InputError, match=message) as caught:
            clean(record(t, decay(i / 50)), name="x")
        assert caught.value.arguments == arguments
        assert "sort" not in str(caught.value) or "sort them" in message


def test_bursts_without_repeated_stamps_need_a_decision_of_the_user():
    """400 samples at 16 Hz, in groups of eight whose stamps are 1 or 10 ms apart, one group each half second."""
    index = np.arange(400)
    t = index / 16
    y = decay(t, zeta=0.1, w=7.0)
    for short in (1e-3, 1e-2):
        raw = record(index // 8 / 2 + short * (index % 8), y)
        message = 'in bursts of about 8 samples: use the clock "uniform" if'
        with pytest.raises(InputError, match=message) as caught:
            clean(raw, name="x")
        assert caught.value.arguments == ("clock",)
        rebuilt = clean(raw, name="x", clock="uniform")
        assert rebuilt.uniform
        assert rebuilt.t[1] == pytest.approx(1 / 16, rel=1e-9)
    times, notes = clock_times(record(t, y), "auto", "x")
    assert (times.tolist(), notes) == (t.tolist(), ())


def test_missing_rows_are_not_taken_for_rounded_stamps():
    """Every tenth row of 100 Hz is missing. Negative control: the same stamps, rounded from 90 Hz."""
    rng, index = np.random.default_rng(5), np.arange(600)
    stamps = index[index % 10 != 9] / 100
    for noise in (0.0, 0.01):
        for t, is_uniform in ((stamps, False), (np.arange(stamps.size) / 90, True)):
            y = decay(t, zeta=0.3, w=25.0) + noise * rng.standard_normal(t.size)
            signal = clean(record(np.floor(t * 100 + 1e-9) / 100, y), name="x")
            assert signal.uniform == is_uniform


def test_a_tone_burst_is_refused():
    """It rises as slowly as it falls. Negative control: records that rise until a drive stops, or within a cycle."""
    t = np.arange(0, 40, 0.02)
    noise = np.random.default_rng(1).standard_normal(t.size)
    tone = np.sin(2 * np.pi * t)
    for cycles, size in ((10, 0.003), (20, 0.05)):
        away = (t - 20) / cycles
        hann = np.where(np.abs(away) < 0.5, np.cos(np.pi * away) ** 2, 0.0)
        for packet in (hann, np.exp(-12.5 * away**2)):
            with pytest.raises(InputError, match="tone burst"):
                clean(record(t, packet * tone + size * noise), name="x")
    for rate in (0.1, 0.4):
        fall = np.exp(-rate * (t - 20))
        driven = np.where(t < 20, 1 - np.exp(-rate * t), (1 - np.exp(-rate * 20)) * fall)
        for envelope in (driven, np.where(t < 20, 0.0, fall)):
            clean(record(t, envelope * tone + 0.003 * noise), name="x")


def test_the_refusal_of_too_few_turning_points_gives_the_part():
    """A slide with friction turns three times within 0.3 s after its release, then it sticks."""
    swing = (1 - np.cos(np.pi * np.arange(14) / 14)) / 2
    ends = [3.43, 0.155, 2.605, 0.89, 1.46]
    slide = [a + (b - a) * swing for a, b in pairwise(ends)]
    y = np.concatenate([np.full(60, ends[0]), *slide, np.full(150, ends[-1])])
    y += 0.005 * np.random.default_rng(1).standard_normal(y.size)
    message = r"the part from 0\.3\d* to 0\.5\d* s .* fewer than three turning points"
    with pytest.raises(InputError, match=message):
        clean(record(np.arange(y.size) / 200, y), name="x")
