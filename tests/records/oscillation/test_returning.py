"""Records that wander instead of oscillating, and oscillations that might be taken for such."""

from __future__ import annotations

import math
from itertools import product

import numpy as np

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.features import features, reason_not_oscillating
from bayesdamp.records.oscillation.law_free import first_words
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError, Refusal, Signal

WALKS = 10


def walk(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    n = int(rng.choice([200, 500, 1000, 2000]))
    return np.arange(n) * 0.01, 0.01 * np.cumsum(rng.standard_normal(n))


def test_random_walks_are_none() -> None:
    """But for a few that swing like one: steps that are independent are no proof, for noise hides that an oscillation's
    are not."""
    said = []
    for seed in range(WALKS):
        try:
            clean(RawRecord(*walk(seed)), name="walk")
        except InputError as refused:
            said.append(str(refused))
    assert len(said) >= 0.9 * WALKS
    assert any("no closer to its earlier values" in one for one in said)


def test_one_step_larger_than_all_others_makes_no_walk() -> None:
    """It would hide that the others are an oscillation's."""
    rng = np.random.default_rng(7)
    t = np.linspace(0.0, 3.7, 260)
    y = np.exp(-0.5 * t) * np.cos(2 * math.pi * t) + 0.037 * rng.standard_normal(t.size)
    holes = np.r_[65:95, 180:200]
    outliers = y.copy()
    outliers[rng.choice(t.size, 8, replace=False)] += 3.0
    for other in ((t, y + 1.5 * (t > t[129])), (t, outliers), (np.delete(t, holes), np.delete(y, holes))):
        assert reason_not_oscillating(*other, 1.0, 0.037) == ""


def test_oscillations_are_none_that_wander() -> None:
    """The control: few cycles and many, coarse and fine, at a noise up to the amplitude itself: where they are refused,
    it is for what noise hides."""
    for noise, ratio, samples in product((0.01, 0.3, 1.0), (0.001, 0.15), (9, 300)):
        t = np.arange(0, 3 if ratio > 0.1 else 8, 1 / samples)
        y = np.exp(-2 * math.pi * ratio * t) * np.cos(2 * math.pi * t)
        y += noise * np.random.default_rng(samples).standard_normal(t.size)
        try:
            said = str(features(Signal(t, y)).cycles)
        except Refusal as refused:
            said = str(refused)
        assert "out of the noise" in said if noise > 0.1 and not said[:1].isdigit() else float(said) > 1


def test_a_frequency_without_an_interval_is_said_without_one() -> None:
    t = np.arange(0, 1.6, 0.01)
    said = first_words(Signal(t, np.exp(-t) * np.cos(2 * np.pi * t))).sentence()
    assert "about" in said
    assert not any(none in said for none in ("inf", "nan"))
