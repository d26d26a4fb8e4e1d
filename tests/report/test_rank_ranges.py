"""Which methods' errors differ by more than luck."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bayesdamp.report.results.estimators import (
    ErrorSeries,
    error_interval,
    is_significantly_better,
    rank_ranges,
)

RNG = np.random.default_rng(5)


def errors(sd: float, count: int, rng: np.random.Generator = RNG) -> dict[int, float]:
    return dict(enumerate(sd * np.abs(rng.standard_normal(count))))


@pytest.mark.parametrize("count", [5, 50])
def test_intervals_hold_the_true_size(count: int):
    """Of 1,000 sets of normal errors 95 % would; Tukey's t is somewhat short for five. Chance of a false alarm 1e-4."""
    rng = np.random.default_rng(count)
    share = np.mean(
        [low <= 2.0 <= high for low, high in (error_interval(errors(2.0, count, rng)) for _ in range(1000))]
    )
    assert (0.88 if count == 5 else 0.91) < share < 0.985


@pytest.mark.parametrize("count", [5, 50])
def test_the_same_method_is_seldom_ahead_of_itself(count: int):
    """Negative control: errors of one size, 1,000 times; 2.5 % would be said to be smaller."""
    rng = np.random.default_rng(count)
    share = np.mean(
        [is_significantly_better(errors(1.0, count, rng), errors(1.0, count, rng)) for _ in range(1000)]
    )
    assert share < 0.05


def test_places_are_ranges():
    """Methods whose errors the repeats cannot tell apart share their ranks: the second and the third."""
    some = (1.0, 1.1, 0.9, 1.05, 0.95)
    errors = {
        "best": {i: 0.1 * some[i % 5] for i in range(50)},
        "few": dict(enumerate(some)),
        "many": {i: some[-1 - i % 5] for i in range(50)},
        "worst": {i: 30 * some[i % 5] for i in range(50)},
    }
    each = {(m, "initial"): [own] for m, own in errors.items()}
    series = ErrorSeries("viscous", "noise", [1.0], {}, {}, [math.nan], each)
    assert rank_ranges(series, "initial", 0) == {
        "best": (1, 1),
        "few": (2, 3),
        "many": (2, 3),
        "worst": (4, 4),
    }
