"""Between exponents at hand the posterior of a power law's exponent does not swing above them."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import Akima1DInterpolator

from bayesdamp.inference.deviation.numbers.rivals import _distribution


def test_a_steep_fall_leaves_a_distribution() -> None:
    """Next to falls of a million nats a smooth curve overshoots far above the likeliest exponent; control: it does
    here."""
    p = np.array([0.09, 2.13, 2.142, 2.175, 2.45, 2.97])
    log = np.array([0.0, -5.6e5, -1.3e6, -2.5e5, -2.4e6, -9.2e5])
    assert Akima1DInterpolator(p, log, method="makima")(np.linspace(p[0], p[-1], 999)).max() > 1e6
    exponents, below = _distribution(p, log)
    assert np.all(np.isfinite(below))
    assert np.all(np.diff(below) > 0)
    assert np.interp(0.5, below, exponents) < 0.2
