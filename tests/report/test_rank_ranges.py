"""Methods have different ranks only if their errors differ by more than chance."""

import math

import numpy as np
import pandas as pd
import pytest

from bayesdamp.report.results.estimators import (
    ErrorSeries,
    error_interval,
    is_significantly_better,
    rank_ranges,
)


@pytest.mark.parametrize("count", [5, 50])
def test_intervals_contain_the_true_size_and_equal_methods_are_rarely_distinguished(count: int):
    """Of 1,000 sets of normal errors 95 % should; Tukey's t is somewhat short for five. False alarms in 1e-4 of seeds.

    Control: of two sets of the same size the first counts as better in 2.5 %.
    """
    rng = np.random.default_rng(count)
    errors = 2.0 * np.abs(rng.standard_normal((1000, 2, count)))
    sets = [[dict(enumerate(each)) for each in pair] for pair in errors]
    inside = [low <= 2.0 <= high for low, high in (error_interval(first) for first, _ in sets)]
    assert (0.88 if count == 5 else 0.91) < np.mean(inside) < 0.985
    assert np.mean([is_significantly_better(*pair) for pair in sets]) < 0.05


def test_methods_that_cannot_be_distinguished_share_their_ranks():
    some = (1.0, 1.1, 0.9, 1.05, 0.95)
    errors = {
        "best": {i: 0.1 * some[i % 5] for i in range(50)},
        "few": dict(enumerate(some)),
        "many": {i: some[-1 - i % 5] for i in range(50)},
        "worst": {i: 30 * some[i % 5] for i in range(50)},
    }
    each = pd.Series({(m, "initial", 0, i): e for m, own in errors.items() for i, e in own.items()})
    series = ErrorSeries("viscous", "noise", [1.0], [math.nan], each.sort_index())
    ranges = {"best": (1, 1), "few": (2, 3), "many": (2, 3), "worst": (4, 4)}
    assert rank_ranges(series, "initial", 0) == ranges
