"""The record's own curves against closed forms: no law is given to them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from scipy.stats import chi2

from bayesdamp.records.oscillation.curves import Curves, _shared, amplitude_curves
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Signal

K, NOISE = 20.0, 1e-4


def curves(damping, restoring=lambda x: K * x, seconds: float = 20.0, noise: float = NOISE) -> Curves:
    """Of an independent solver's record: 4,000 samples from 0.3 rad, seed fixed."""
    t = np.linspace(0.0, seconds, 4000)
    found = solve_ivp(
        lambda _, s: [s[1], -damping(s[1]) - restoring(s[0])], (0, seconds), [0.3, 0.0],
        method="DOP853", t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01,
    )  # fmt: skip
    y = found.y[0] + noise * np.random.default_rng(1).standard_normal(t.size)
    signal = Signal(t, y)
    return amplitude_curves(signal, features(signal))


def test_viscous_damping_is_a_constant() -> None:
    found = curves(lambda v: 2 * 0.05 * v)
    exact = 0.05 / np.sqrt(K - 0.05**2)
    assert np.all(np.abs(found.ratio - exact) < 5 * found.ratio_sd + 1e-3 * exact)
    assert found.frequency == pytest.approx(np.sqrt(K - 0.05**2), rel=1e-3)


def test_coulomb_friction_falls_as_the_inverse_and_quadratic_damping_grows() -> None:
    coulomb = curves(lambda v: 0.03 * np.sign(v))
    # The amplitude falls by 2μ/k a swing: exactly linear, whatever the amplitude.
    assert coulomb.ratio * coulomb.amplitude == pytest.approx(2 * 0.03 / (np.pi * K), rel=0.02)
    quadratic = curves(lambda v: 0.05 * v * np.abs(v))
    assert quadratic.ratio / quadratic.amplitude == pytest.approx(4 * 0.05 / (3 * np.pi), rel=0.02)
    # Negative controls: neither is a constant, nor the other.
    assert np.ptp(coulomb.ratio) > 20 * coulomb.ratio_sd.max()
    assert np.ptp(quadratic.ratio) > 20 * quadratic.ratio_sd.max()


def test_the_backbone_of_a_pendulum_is_the_elliptic_integral() -> None:
    found = curves(lambda v: 2 * 0.02 * v, lambda x: K * np.sin(4.0 * x) / 4.0)  # 1.2 rad of a pendulum
    exact = np.sqrt(K) * np.pi / (2 * ellipk(np.sin(2.0 * found.amplitude) ** 2))
    assert found.frequency == pytest.approx(exact, rel=2e-3)
    assert np.ptp(exact) > 0.03 * exact[0]  # a constant would not pass


def test_the_backbone_of_a_hardening_spring_is_the_elliptic_integral() -> None:
    hard = 60.0
    found = curves(lambda v: 2 * 0.02 * v, lambda x: K * x + hard * x**3)
    stiff = K + hard * found.amplitude**2
    exact = np.sqrt(stiff) * np.pi / (2 * ellipk(hard * found.amplitude**2 / (2 * stiff)))
    assert found.frequency == pytest.approx(exact, rel=2e-3)
    assert np.ptp(exact) > 0.03 * exact[0]  # a constant would not pass


def squares(noise: float, count: int) -> np.ndarray:
    """Mean squares (2, count) of damping and frequency about the truth, in their sds, of as many noisy records."""
    t, zeta = np.linspace(0.0, 20.0, 4000), 0.05
    omega = np.sqrt(K - zeta**2)
    motion = 0.3 * np.exp(-zeta * t) * (np.cos(omega * t) + zeta / omega * np.sin(omega * t))
    found = []
    for seed in range(count):
        signal = Signal(t, motion + noise * np.random.default_rng([7, seed]).standard_normal(t.size))
        seen = amplitude_curves(signal, features(signal))
        found += [
            (
                ((seen.ratio - zeta / omega) / seen.ratio_sd) ** 2,
                ((seen.frequency - omega) / seen.frequency_sd) ** 2,
            )
        ]
    return np.concatenate([np.array(f) for f in found], axis=1)


@pytest.mark.parametrize("noise", [1e-3, 3e-3])
def test_the_band_is_as_wide_as_the_noise_makes_it(noise: float) -> None:
    """Mean squares in the 99.9 % band of a chi-square over its freedom, widened below: an sd is never less than the
    noise's, and may be more where scatter says so. A false alarm in five hundred runs for each of four."""
    scores = squares(noise, 100)
    low, high = chi2.ppf([0.0005, 0.9995], scores.shape[1]) / scores.shape[1]
    for each in scores.mean(axis=1):
        assert 0.7 * low < each < high
        assert 4 * each > high  # the control: sds half as large are seen


def test_errors_that_neighbours_share_are_whitened_as_by_the_whole_covariance() -> None:
    rng = np.random.default_rng(2)
    ends, ranges, values = rng.uniform(0.1, 0.2, 8), rng.uniform(1, 2, 7), rng.normal(size=(7, 3))
    steps = (np.eye(7, 8) + np.eye(7, 8, 1)) * ends / ranges[:, None]
    whole = np.linalg.cholesky(steps @ steps.T + 1e-9 * np.eye(7))
    assert _shared(ends, ranges).whitened(values, 1e-9) == pytest.approx(np.linalg.solve(whole, values))
