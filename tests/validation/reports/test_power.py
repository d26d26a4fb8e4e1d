"""The power of a test of coverage is that of simulated draws."""

from __future__ import annotations

import numpy as np
from scipy.stats import binomtest, norm

from validation.reports.calibration import power


def test_power_is_the_share_of_draws_that_are_rejected():
    """4,000 draws, within four standard errors: false alarms in 1 of 16,000 seeds."""
    n, level, alarm, width = 60, 0.95, 0.05, 0.7
    rng = np.random.default_rng(7)
    hits = (np.abs(rng.standard_normal((4000, n))) < width * norm.ppf(0.975)).sum(axis=1)
    table = np.array([binomtest(k, n, level).pvalue < alarm for k in range(n + 1)])
    share = table[hits].mean()
    assert abs(share - power(n, level, alarm, width)) < 4 * np.sqrt(share * (1 - share) / 4000)
    assert power(n, level, alarm, 1.0) <= alarm
