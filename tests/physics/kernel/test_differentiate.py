"""Derivatives of forces, generated from their source, against central differences."""

import math
from typing import Any

import numpy as np
import pytest

from bayesdamp.physics.kernel.build import SLOPES, NoSlopeError, derivative_source, difference_source

TIMES = np.linspace(0.0, 6.0, 161)


def functions(*sources: str) -> dict[str, Any]:
    """Return the functions of sources, not compiled."""
    space: dict[str, Any] = {"njit": lambda function: function, "math": math, "np": np, "_tanh": math.tanh}
    exec("\n\n".join(sources), space)
    return space


def errors(source: str, slopes: str, at: tuple[float, ...]) -> np.ndarray:
    """Return the errors of the value and derivatives that g gives for f, against central differences."""
    space = functions(source, slopes)
    f, g = space["f"], space["g"]
    expected = [f(*at)]
    for i in range(len(at)):
        ends = [f(*at[:i], at[i] + d, *at[i + 1 :]) for d in (1e-5, -1e-5)]
        expected.append((ends[0] - ends[1]) / 2e-5)
    return np.abs(np.array(g(*at, None)) - expected)


RULES = [
    *(f"{'' if f == 'abs' else 'math.'}{f}(0.1 + v * v - x * 0.3)" for f in SLOPES if f != "arctan"),
    "np.arctan(x * v)", "max(x, v) * min(v, x * x)", "x ** v", "x ** 3 / v ** 2", "x ** 1.5 - math.pi * v",
]  # fmt: skip


def test_every_rule_gives_the_derivative() -> None:
    """Control: the function times 1.001."""
    for text in RULES:
        source = f"def f(x, v):\n    u = {text}\n    u = u + x\n    return u\n"
        slopes = derivative_source(source, "g", ["x", "v"])
        assert np.all(errors(source, slopes, (0.4, 0.7)) < 1e-7), text
        assert np.any(errors(source.replace("return u", "return 1.001 * u"), slopes, (0.4, 0.7)) > 1e-5), text


@pytest.mark.parametrize("body", ["return v if v > 0.0 else 2.0 * v", "return math.erf(v)"])
def test_a_function_without_a_rule_is_differentiated_numerically(body: str) -> None:
    source = f"def f(x, v):\n    {body}\n"
    with pytest.raises(NoSlopeError):
        derivative_source(source, "g", ["x", "v"])
    slopes = difference_source("f({}, {})", ["x", "v", "sizes"], {"x": "1e-6", "v": "1e-6"}, "g")
    assert np.all(errors(source, slopes, (0.4, 0.7)) < 1e-7)
