"""Damping ratios if the width of friction about zero velocity is not known, against closed forms and quadrature."""

import math

import numpy as np
import pytest

from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.findings import compute_findings
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.types import Ratio, Signal
from tests.physics.independent import trajectory, viscous, with_coulomb
from validation.truth.ratio import harmonic_ratio

HERTZ, RATIO, SIZE = 5.0, 5.1e-4, 0.1
W, A, MU, ZETA = 4.5, 0.3, 0.06, 0.02
PEAK = W * A


def test_the_ratio_does_not_depend_on_the_split_between_indistinguishable_terms() -> None:
    """Viscous damping over 500 cycles, fitted with viscous and structural damping. The split between the two depends
    on the width. With the noise of this seed both have a coefficient."""
    t, w = np.linspace(0, 500 / HERTZ, 20000), 2 * math.pi * HERTZ
    y = viscous(t, RATIO * w, w, SIZE) + 0.01 * SIZE * np.random.default_rng(4).standard_normal(t.size)
    comparison = compare_signal(Signal(t, y), damping=["viscous", "structural"], restoring=["linear"])
    coefficients = np.array([f.coefficients for f in comparison.frictions])
    assert np.all(np.ptp(coefficients, axis=0) > 0.2 * coefficients.max(axis=0))  # the split does change
    for r in compute_findings(comparison).ratios:
        assert r.low < RATIO < r.high
        assert r.high - r.low < 0.03 * RATIO


def ratios(share: float, seed: int, known: dict[str, float] | None = None) -> tuple[Ratio, ...]:
    """Return the ratios on a record of viscous damping and friction with this width, which is
    a share of the peak velocity."""
    p = {"zeta": ZETA, "mu_c": MU, "epsilon": share * PEAK, "stiffness": W**2, "theta0": A, "omega0": 0.0}
    t = np.arange(0.0, 30.0, 0.02)
    y = trajectory("linear", p | {"rest_angle": 0.0}, t)[:, 0]
    y += 0.003 * A * np.random.default_rng(seed).standard_normal(t.size)
    sums = ["viscous", "coulomb", "viscous+coulomb"]
    comparison = compare_signal(Signal(t, y), damping=sums, restoring=["linear"], known=known)
    return compute_findings(comparison, amplitudes=[0.2, 0.05, 0.02, 0.01]).ratios


def truth(amplitude: float, share: float) -> float:
    """Return the equivalent ratio for a harmonic motion."""
    return harmonic_ratio(lambda x, v: 2 * ZETA * v + MU * math.tanh(v / (share * PEAK)), amplitude, W)


SHARE = 0.01


@pytest.mark.slow
@pytest.mark.parametrize("share", [SHARE, 0.03])
def test_intervals_contain_the_true_ratio_if_the_width_is_not_known(share: float) -> None:
    """At each amplitude in at least 8 of 10 records (false alarm 1.2 % each). A share of 0.03 is between those that are
    tried: without widths between them the last interval contains the truth in 3 of 10 records."""
    records = [ratios(share, seed) for seed in range(110, 120)]
    contained = [[r.low < truth(r.amplitude, share) < r.high for r in record] for record in records]
    assert np.min(np.sum(contained, axis=0)) >= 8


def test_an_interval_under_a_wrong_width_does_not_contain_the_true_ratio() -> None:
    """Negative control: near rest, a tenth of the width means another loss."""
    last = ratios(SHARE, 0, {"epsilon": 0.1 * SHARE * PEAK})[-1]
    assert not last.low < truth(last.amplitude, SHARE) < last.high


def test_friction_in_rounded_values_is_identified_as_sharp(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gaussian and quantised noise are both compared on a record that is rounded to 0.1 degrees. Control: with the
    width of least squares the friction is wrong, and drag compensates for it."""
    t, step = np.linspace(0.0, 40.0, 4000), np.radians(0.1)
    start = {"rest_angle": 0.0, "theta0": 0.4, "omega0": 0.0}
    p = {"zeta": 0.01, "mu_c": 0.03, "epsilon": 0.0, "stiffness": 25.0, **start}
    signal = Signal(t, step * np.round(trajectory("linear", p, t)[:, 0] / step), step=step)
    sums = ["viscous+coulomb", "viscous+coulomb+quadratic"]

    def answered() -> tuple[str, float]:
        result = answer(signal, compare_models(signal, damping=sums, restoring=["linear"]), sample=False)
        assert {"gaussian", "quantised"} <= {noise.name for noise in result.content.noises}
        return result.verdict.damping, next(c.value for c in result.verdict.coefficients if c.name == "mu_c")

    assert answered() == ("viscous+coulomb", pytest.approx(0.03, rel=3e-4))
    monkeypatch.setattr("bayesdamp.inference.deviation.model_comparison.SHARPER", 0.0)
    assert answered()[1] != pytest.approx(0.03, rel=3e-4)


@pytest.mark.parametrize("kind", ["averaged", "hum"])
def test_sharp_friction_is_not_identified_as_wide(kind: str) -> None:
    """In a record whose motion is averaged, and in one with a hum at 1.36 times the frequency of the oscillation.

    If the averaged motion is corrected at another width, or the hum counts as white noise, widths of 1 % and more have
    a probability above 0.98 (control: their prior probability is 0.3).
    """
    cycles, size, per_cycle, noise = (600, 0.0, 20, 0.004) if kind == "averaged" else (12, 0.04, 48, 0.001)
    t = np.arange(cycles * per_cycle) / per_cycle
    start = {"rest_angle": 0.0, "theta0": 1.0, "omega0": 0.0}
    y = with_coulomb({"stiffness": 4 * np.pi**2, "mu_c": np.pi**2 * 0.95 / cycles, **start}, t)[:, 0]
    y += size * np.sin(2 * np.pi * 1.36 * t + 1)
    y += noise * np.random.default_rng(3).standard_normal(t.size)
    comparison = compare_signal(Signal(t, y), damping=["coulomb"], restoring=["linear"])
    assert (comparison.data.averaged is None) == (kind == "hum")
    peak = comparison.reference.peak_velocity
    assert sum(f.weight for f in comparison.frictions if f.epsilon > 0.0099 * peak) < 0.5
