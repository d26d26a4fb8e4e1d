"""How sharply friction turns over: found where the record shows it, left as it was where it does not.

Records are SciPy's, of friction that is tanh(v/ε) or a sign.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.fit import friction_choice
from bayesdamp.inference.fit.friction_choice import LEAD, Tried, epsilon_note, weigh_epsilons
from bayesdamp.inference.fit.noise_choice import Fitted, fit_with
from bayesdamp.inference.model.build import build_target
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.inference.model.target import Target
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Seed, Signal, System

TIMES = np.linspace(0.0, 12.0, 600)
START, STIFFNESS, ZETA = 0.5, 20.0, 0.02
PEAK = START * np.sqrt(STIFFNESS)
DAMPING = ("viscous", "coulomb", "quadratic")


def record(friction: float, share: float, noise: float) -> Signal:
    """friction: μc, rad/s²; share: ε by the peak velocity; noise: sd by the amplitude."""

    def motion(_, s):
        force = friction * np.tanh(s[1] / (share * PEAK)) + 2 * ZETA * s[1]
        return [s[1], -STIFFNESS * s[0] - force]

    y = solve_ivp(motion, (0, TIMES[-1]), [START, 0.0], "LSODA", TIMES, rtol=1e-9, atol=1e-11).y[0]
    return Signal(TIMES, y + noise * START * np.random.default_rng(3).standard_normal(TIMES.size))


def chosen(signal: Signal) -> tuple[float, list[Tried], Fitted]:
    """The share that is taken, all that were tried, and the fit."""
    seen = features(signal)
    reference = Reference(START, float(np.sqrt(STIFFNESS)))

    def build(epsilon: float) -> Target:
        system = System("linear", {"rest_angle": 0.0, "epsilon": epsilon})
        return build_target(signal, DAMPING, system, seen, reference)

    near = {"zeta": 0.03, "mu_c": 0.2, "mu_q": 0.02, "stiffness": 20.1, "theta0": 0.5, "omega0": 0.01}
    usual = fit_with(build(0.02 * PEAK), {Seed("near"): near}, seen)
    best, tried = weigh_epsilons(build, usual, PEAK, seen)
    return best.target.known["epsilon"] / PEAK, tried, best


@pytest.mark.parametrize("truth", [0.05, 0.03, 0.007, 0.001])
def test_the_friction_of_a_precise_record_is_found(truth):
    """Within a tenth or, where it is too sharp to be seen, within a step of those that are tried; with it friction's
    coefficient is right to four standard errors (a false alarm in 16,000), with the usual one it is not."""
    share, tried, fit = chosen(record(0.3, truth, 0.0005))
    assert abs(np.log(share / truth)) < (0.1 if truth > 0.002 else 1.0)
    assert {0.02, share} <= {t.share for t in tried}
    assert [t.share for t in tried] == sorted((t.share for t in tried), reverse=True)
    friction = {t.share: t.coefficients["mu_c"] for t in tried}
    assert abs(friction[share][0] - 0.3) < 4 * friction[share][1]
    assert abs(friction[0.02][0] - 0.3) > 4 * friction[share][1]
    values = fit.target.values(fit.mode.z)
    assert float(values["mu_c"]) == friction[share][0]
    assert abs(float(values["zeta"]) - ZETA) < 0.004
    note = epsilon_note(tried, share * PEAK, "rad")
    assert f"{100 * share:g} % of the peak velocity" in note
    assert "ahead of the usual 2 %" in note


def test_between_two_that_are_tried_lies_a_better_one(monkeypatch):
    """Worth tens of nats on such a record. Negative control: without looking there."""
    signal = record(0.3, 0.007, 0.0005)
    _, _, fit = chosen(signal)
    monkeypatch.setattr(friction_choice, "BETWEEN", 0)
    share, _, coarse = chosen(signal)
    assert share == 0.005
    assert fit.log_evidence > coarse.log_evidence + 10.0


@pytest.mark.parametrize(
    ("friction", "truth", "noise"), [(0.1, 0.005, 0.03), (0.0, 0.02, 0.0005), (0.3, 0.02, 0.0005)]
)
def test_a_record_that_does_not_show_it_keeps_the_usual_one(friction, truth, noise):
    """Much noise; no friction; and the usual one the truth: of records such as these none was ahead by three nats."""
    share, tried, _ = chosen(record(friction, truth, noise))
    assert share == 0.02
    best = max(t.log_evidence for t in tried)
    assert best - next(t.log_evidence for t in tried if t.share == 0.02) < LEAD
    assert epsilon_note(tried, None, "rad") == ""
    # Where friction is lost in the noise, or there is none, no other is tried.
    assert (len(tried) == 1) == (friction < 0.3)
