"""How a result on an envelope is worded."""

from __future__ import annotations

import pytest

from bayesdamp.envelope.words import _places


@pytest.mark.parametrize(
    ("width", "places"), [(0.4, 2), (0.06, 2), (0.02, 3), (0.002, 4), (1e-9, 6), (0.0, 2)]
)
def test_an_exponent_s_interval_is_not_rounded_away(width: float, places: int) -> None:
    assert _places(width) == places
    low, high = (f"{1 + side * width / 2:.{places}f}" for side in (-1, 1))
    assert (low != high) == (width > 1e-8)
