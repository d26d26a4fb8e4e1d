"""Tests of the Levenberg–Marquardt search: where a function is not finite, the best point before is returned."""

import numpy as np
import pytest

from bayesdamp.numerics.levenberg_marquardt import Expansion, Step, levenberg_marquardt

FLOOR = np.array([-np.inf])


def parabola_until(end: float, value_beyond: float | None, information_beyond: float):
    """Return the expansion of −(x − 2)²/2; beyond `end` its value and information are replaced."""

    def expand(x: np.ndarray) -> Expansion:
        value, information = -0.5 * float((x[0] - 2.0) ** 2), 1.0
        if x[0] > end:
            value, information = value if value_beyond is None else value_beyond, information_beyond
        return Expansion(value, 2.0 - x, np.array([[information]]))

    return expand


def is_short(step: Step) -> bool:
    return bool(np.abs(step.move).max() < 1e-9)


@pytest.mark.parametrize("beyond", [(None, np.nan), (None, np.inf), (np.nan, 1.0), (-np.inf, 1.0)], ids=str)
def test_the_best_finite_point_is_returned(beyond: tuple[float | None, float]):
    """A step to a point without a finite value and information is rejected, also if the value increases."""
    end = levenberg_marquardt(parabola_until(1.5, *beyond), np.zeros(1), FLOOR, is_short, limit=50)
    assert np.isfinite(end.value)
    assert 0.0 <= end.x[0] <= 1.5
    assert end.value >= -2.0
    assert np.all(np.isfinite(end.information))


def test_a_start_that_is_not_finite_has_no_maximum():
    end = levenberg_marquardt(parabola_until(-1.0, None, np.nan), np.zeros(1), FLOOR, is_short, limit=50)
    assert end.value == -np.inf
    assert not end.converged
