"""Every estimator recovers a damping term from a clean record of another solver, or says why it cannot."""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.estimators import ESTIMATORS, names_for_all, run
from bayesdamp.estimators.shared import reason_not_applicable, table
from bayesdamp.physics.damping import TERMS
from bayesdamp.types import Problem, Signal, System
from tests.estimators.truths import NETS

K, A, EPSILON = 20.0, 0.3, 0.05
V = A * math.sqrt(K)
KNOWN = {"stiffness": K, "rest_angle": 0.0, "theta0": A, "omega0": 0.0, "epsilon": EPSILON}
SYSTEM = System("linear", KNOWN, {}, A, math.sqrt(K))
Truth = tuple[dict[str, float], Callable[[float, float], float]]


def smooth_sign(v: float) -> float:
    return math.tanh(v / EPSILON)


TRUTHS: dict[str, Truth] = {
    "viscous": ({"zeta": 0.05}, lambda x, v: 2 * 0.05 * v),
    "coulomb": ({"mu_c": 0.03}, lambda x, v: 0.03 * smooth_sign(v)),
    "quadratic": ({"mu_q": 0.05}, lambda x, v: 0.05 * v * abs(v)),
    "cubic": ({"mu_3": 0.06}, lambda x, v: 0.06 * v**3),
    "displacement": ({"c_xxv": 3.0}, lambda x, v: 3.0 * x * x * v),
    "structural": ({"kappa": 0.8}, lambda x, v: 0.8 * abs(x) * smooth_sign(v)),
    "dry_position": (
        {"mu_p": 0.04, "friction_slope": 0.3, "friction_curvature": 0.8},
        lambda x, v: 0.04 * (1 + 0.3 * x / A + 0.8 * (x / A) ** 2) * smooth_sign(v),
    ),
    "power": (
        {"c_power": 0.06, "exponent": 1.5},
        lambda x, v: 0.06 * v * ((v * v + EPSILON * EPSILON) / (V * V)) ** 0.25,
    ),
    "stribeck": (
        {"mu_k": 0.03, "static_excess": 0.8, "stribeck_velocity": 0.4},
        lambda x, v: 0.03 * (1 + 0.8 * math.exp(-((v / 0.4) ** 2))) * smooth_sign(v),
    ),
}
SAMPLES = {"least_squares": 6000}
"""In 15 s; 1500 for the others. The regression smooths a record, which would hide a narrow feature of the force."""
LIMIT = 0.02
"""Largest relative error of an initial estimate."""
WIDER = {("topological", "coulomb"): 0.05}
POSITION, FURTHER = {"displacement", "structural", "dry_position"}, {"dry_position", "power", "stribeck"}
OTHERS = set(TRUTHS) - {"viscous", "coulomb", "quadratic"}
REFUSED = {
    **dict.fromkeys(names_for_all(), FURTHER),
    **dict.fromkeys(("pinn", "neural_ode", "symbolic_regression"), POSITION | FURTHER),
    "topological": OTHERS,
}


@lru_cache
def record(term: str, samples: int) -> Signal:
    force, t = TRUTHS[term][1], np.linspace(0.0, 15.0, samples)

    def slope(_: float, s: np.ndarray) -> tuple[float, float]:
        return s[1], -force(s[0], s[1]) - K * s[0]

    y = solve_ivp(slope, (0.0, 15.0), (A, 0.0), "DOP853", t, rtol=1e-10, atol=1e-12, max_step=0.01).y[0]
    return Signal(t, y, name=term)


def test_the_table_has_every_estimator_and_term() -> None:
    assert len(REFUSED) == len(names_for_all()) == 11
    assert set(TRUTHS) == {n for n in TERMS.names() if TERMS.ships(n)}
    rows = dict(table([ESTIMATORS.get(n) for n in REFUSED], list(TRUTHS)))
    for name, refused in REFUSED.items():
        assert {t for t, why in zip(TRUTHS, rows[name], strict=True) if why} == refused, name


def test_an_estimator_that_cannot_use_a_term_says_why() -> None:
    for name, term in ((n, t) for n, ts in REFUSED.items() for t in sorted(ts)):
        (estimate,) = run(name, record(term, 1500), Problem((term,), SYSTEM), stages=("initial",), seed=1)
        assert not estimate.values, name
        assert estimate.outcome == reason_not_applicable(ESTIMATORS.get(name), (term,))
        assert term in estimate.outcome
        assert len(estimate.outcome) < 160


FAST_TERMS = ("cubic", "displacement", "structural")
PAIRS = [
    pytest.param(n, t, marks=[] if n not in (*NETS, "genetic") and t in FAST_TERMS else pytest.mark.slow)
    for n, refused in REFUSED.items()
    for t in TRUTHS
    if t not in refused
]
"""Other files of this folder test the three terms of the paper with every method."""


@pytest.mark.parametrize(("name", "term"), PAIRS)
def test_an_estimator_recovers_a_term(name: str, term: str) -> None:
    """The coefficient of the term; the restoring law and the start are known."""
    samples = SAMPLES.get(name, 1500)
    (estimate,) = run(name, record(term, samples), Problem((term,), SYSTEM), stages=("initial",), seed=1)
    assert name != "sindy" or estimate.outcome == "ok"  # its selection of terms
    limit = WIDER.get((name, term), LIMIT)
    for parameter, truth in TRUTHS[term][0].items():
        assert abs(estimate.values[parameter] / truth - 1) < limit, parameter
