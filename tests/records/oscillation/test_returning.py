"""Random walks are refused; oscillations that resemble them are not."""

import math
from itertools import product

import numpy as np

from bayesdamp.interface.first_words import first_words
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.features import features, reason_not_oscillating
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError, Refusal, Signal


def test_random_walks_are_refused() -> None:
    """Nine of ten: a few walks swing like an oscillation."""
    messages = []
    for rng in map(np.random.default_rng, range(10)):
        n = int(rng.choice([200, 500, 1000, 2000]))
        try:
            clean(RawRecord(np.arange(n) * 0.01, 0.01 * np.cumsum(rng.standard_normal(n))), name="walk")
        except InputError as refusal:
            messages.append(str(refusal))
    assert len(messages) >= 9
    assert any("no closer to its earlier values" in message for message in messages)


def test_an_oscillation_with_one_large_step_is_not_a_random_walk() -> None:
    """The step, outliers or gaps would hide that the other steps are those of an oscillation."""
    rng = np.random.default_rng(7)
    t = np.linspace(0.0, 3.7, 260)
    y = np.exp(-0.5 * t) * np.cos(2 * math.pi * t) + 0.037 * rng.standard_normal(t.size)
    gaps = np.r_[65:95, 180:200]
    outliers = y.copy()
    outliers[rng.choice(t.size, 8, replace=False)] += 3.0
    for record in ((t, y + 1.5 * (t > t[129])), (t, outliers), (np.delete(t, gaps), np.delete(y, gaps))):
        assert reason_not_oscillating(*record, 1.0, 0.037) == ""


def test_oscillations_are_not_random_walks() -> None:
    """Negative control: few cycles and many, coarse and fine, with noise up to the amplitude.

    The only reason for a refusal is that the noise hides the oscillation.
    """
    for noise, ratio, samples in product((0.01, 0.3, 1.0), (0.001, 0.15), (9, 300)):
        t = np.arange(0, 3 if ratio > 0.1 else 8, 1 / samples)
        y = np.exp(-2 * math.pi * ratio * t) * np.cos(2 * math.pi * t)
        y += noise * np.random.default_rng(samples).standard_normal(t.size)
        try:
            cycles, refusal = features(Signal(t, y)).cycles, ""
        except Refusal as error:
            cycles, refusal = math.inf, str(error)
        assert cycles > 1
        assert not refusal or (noise > 0.1 and "out of the noise" in refusal)


def test_a_frequency_without_an_interval_is_written_without_one() -> None:
    t = np.arange(0, 1.6, 0.01)
    sentence = first_words(Signal(t, np.exp(-t) * np.cos(2 * np.pi * t))).sentence
    assert "about" in sentence
    assert not any(word in sentence for word in ("inf", "nan"))
