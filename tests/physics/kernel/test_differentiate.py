"""Slopes of forces from their source against central differences; what no rule is known of."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bayesdamp.physics.damping import TERMS, DampingTerm
from bayesdamp.physics.kernel import Solver, build
from bayesdamp.physics.kernel.build import _arguments, _function
from bayesdamp.physics.kernel.differentiate import SLOPES, NoSlopeError, differenced, differentiated
from bayesdamp.physics.kernel.solve import ALL
from bayesdamp.physics.restoring import LAWS, RestoringLaw

TIMES = np.linspace(0.0, 6.0, 161)
NUMBERS = (0.31, -0.23, 0.11, 0.7, 0.4, 0.05, 1.3)
"""Of a kernel's arguments in order: within the domain of every function."""


def functions(*sources: str) -> dict[str, Any]:
    """The functions of sources, not compiled."""
    space: dict[str, Any] = {"njit": lambda one: one, "math": math, "np": np, "_tanh": math.tanh}
    exec("\n\n".join(sources), space)
    return space


def errors(source: str, slopes: str, at: tuple[float, ...]) -> np.ndarray:
    """Of the value and of each slope that g gives of f, by central differences over 1e-5."""
    made = functions(source, slopes)
    wanted = [made["f"](*at)]
    for i in range(len(at)):
        ends = [made["f"](*at[:i], at[i] + d, *at[i + 1 :]) for d in (1e-5, -1e-5)]
        wanted.append((ends[0] - ends[1]) / 2e-5)
    return np.abs(np.array(made["g"](*at)) - wanted)


def test_every_term_that_ships_has_its_slopes() -> None:
    for name in TERMS.names():
        source = _function(TERMS.get(name), DampingTerm, "f", name)
        given = _arguments(source)
        assert np.all(errors(source, differentiated(source, "g", given), NUMBERS[: len(given)]) < 1e-7), name


def test_every_law_that_ships_has_its_slopes() -> None:
    for name in LAWS.names():
        count = len(LAWS.get(name).parameters)
        source = _function(LAWS.get(name), RestoringLaw, "f", name)
        slopes = differentiated(source, "g", ["x", *(f"p[{i}]" for i in range(count))])
        made, p = functions(source, slopes), list(NUMBERS[1 : count + 1])
        for i, slope in enumerate(made["g"](NUMBERS[0], p)[1:]):
            ends = []
            for d in (1e-5, -1e-5):
                moved = [NUMBERS[0], *p]
                moved[i] += d
                ends.append(made["f"](moved[0], moved[1:]))
            assert slope == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-7), name


RULES = [
    *(f"{'' if f == 'abs' else 'math.'}{f}(0.1 + v * v - x * 0.3)" for f in SLOPES if f != "arctan"),
    "np.arctan(x * v)", "max(x, v) * min(v, x * x)", "x ** v", "x ** 3 / v ** 2", "x ** 1.5 - math.pi * v",
]  # fmt: skip


def test_rules() -> None:
    """The control: of the function times 1.001 they are not the slopes."""
    for text in RULES:
        source = f"def f(x, v):\n    u = {text}\n    u = u + x\n    return u\n"
        slopes = differentiated(source, "g", ["x", "v"])
        assert np.all(errors(source, slopes, (0.4, 0.7)) < 1e-7), text
        assert np.any(errors(source.replace("return u", "return 1.001 * u"), slopes, (0.4, 0.7)) > 1e-5), text


@pytest.mark.parametrize("body", ["return v if v > 0.0 else 2.0 * v", "return math.erf(v)"])
def test_what_no_rule_is_known_of_is_differenced(body: str) -> None:
    source = f"def f(x, v):\n    {body}\n"
    with pytest.raises(NoSlopeError):
        differentiated(source, "g", ["x", "v"])
    slopes = differenced("f({x}, {v})", ["x", "v"], {"x": "1e-6", "v": "1e-6"}, "g")
    assert np.all(errors(source, slopes, (0.4, 0.7)) < 1e-7)


def test_a_kernel_by_differences_has_the_same_tangents(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms with and without parameters of their own, and a law."""
    epsilon = 0.05
    knots = np.linspace(0.0, TIMES[-1], 4)
    made = Solver(("stribeck", "viscous"), "duffing", TIMES, "angle", 0.3, math.sqrt(20.0), epsilon, knots)
    values = {"stribeck_velocity": 0.2, "static_excess": 0.5, "zeta": 0.05, "stiffness": 20.0, "theta0": 0.3}
    p = np.array([values.get(n, 0.03) for n in made.names])
    found = made.solve(p, np.ones(2, bool), tangents=ALL)
    monkeypatch.setattr(build, "differentiated", unknown)
    other = build.kernel_of(made.terms, (made.restoring,))
    monkeypatch.setattr(Solver, "kernel", other)
    again = Solver(made.terms, "duffing", TIMES, "angle", 0.3, math.sqrt(20.0), epsilon, knots)
    wanted = again.solve(p, np.ones(2, bool), tangents=ALL)
    assert found is not None
    assert wanted is not None
    scale = np.max(np.abs(wanted.tangents), axis=0)
    assert np.all(np.abs(found.tangents - wanted.tangents) < 1e-6 * scale)


def unknown(*_: object) -> str:
    raise NoSlopeError
