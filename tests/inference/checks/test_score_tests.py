"""Score tests for further forces: false alarms under the true model, and responses to the forces."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.checks import check_fit, tangents
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.residual_tests import (
    FORMS,
    StrongestForm,
    find_missing_form,
    orthonormal,
    responses_to_forms,
)
from bayesdamp.inference.search import find_mode
from tests.inference.problems import linear_target
from tests.physics.independent import with_coulomb

TIMES = np.linspace(0.0, 12.0, 300)
K, ZETA, NOISE = 20.0, 0.08, 0.003


def trajectory_with(form: int, size: float) -> np.ndarray:
    """Return the trajectory of a viscous oscillator with a further force of this form and size, by SciPy."""

    def slope(t: float, s: np.ndarray) -> list[float]:
        unit = np.array([s[0] / X, s[1] / V, t / TIMES[-1] - 0.5])[:, None]
        return [s[1], float(-2 * ZETA * s[1] - K * s[0] - size * FORMS[form].force(*unit)[0])]

    fine = {"rtol": 1e-10, "atol": 1e-12, "max_step": 0.01}
    return solve_ivp(slope, (0, TIMES[-1]), [0.3, 0.2], t_eval=TIMES, **fine).y[0]


def reach() -> tuple[float, float]:
    """Return the largest displacement and velocity of the viscous oscillator."""
    t = np.linspace(0.0, 3.0, 30_001)
    omega = np.sqrt(K - ZETA**2)
    x = np.exp(-ZETA * t) * (0.3 * np.cos(omega * t) + (0.2 + 0.3 * ZETA) / omega * np.sin(omega * t))
    return float(np.abs(x).max()), float(np.abs(np.gradient(x, t)).max())


X, V = reach()


TRUTH = {"zeta": ZETA, "theta0": 0.3, "omega0": 0.2}
KNOWN = {"stiffness": K, "noise_sd": NOISE}


def fitted(form: int, size: float) -> tuple[Target, Mode]:
    """Return target and mode of the viscous oscillator on a trajectory without noise."""
    target = linear_target(TIMES, trajectory_with(form, size), "viscous", KNOWN)
    return target, find_mode(target, [TRUTH], noise_level=NOISE)


def strongest_form(target: Target, mode: Mode, noise: np.ndarray) -> StrongestForm:
    """Return the result of the test after adding noise, (n,) in units of its sd, to the residuals, without the part
    that the fit absorbs."""
    absorbed = orthonormal(tangents(target, mode).T)
    scores = mode.likelihood.whitened(mode.likelihood.residual(mode.z), mode.z)
    scores = scores + noise - absorbed @ (absorbed.T @ noise)
    return find_missing_form(mode, scores, absorbed, lambda change: change / NOISE)


def test_p_values_of_the_true_model_are_as_small_as_stated() -> None:
    """For 400 series of noise: a twentieth below 0.05, within three binomial sds (a false alarm in 700), and at least
    a fifth of that. Control: noise that is larger than that of the model has smaller p values."""
    target, mode = fitted(0, 0.0)
    rng = np.random.default_rng(11)
    chances = np.array(
        [strongest_form(target, mode, rng.standard_normal(TIMES.size)).chance for _ in range(400)]
    )
    most = 0.05 + 3 * np.sqrt(0.05 * 0.95 / 400)
    assert 0.01 < np.mean(chances < 0.05) < most
    louder = [strongest_form(target, mode, 1.5 * rng.standard_normal(TIMES.size)).chance for _ in range(100)]
    assert np.mean(np.array(louder) < 0.05) > most


def test_the_verdict_names_the_form() -> None:
    """Cubic damping under a viscous fit, which the checks of fits.csv refuse. Control: a viscous record fits."""
    noise = np.random.default_rng(13).standard_normal(TIMES.size)
    for size, verdict in ((0.1, "does not fit"), (0.0, "fits")):
        target = linear_target(TIMES, trajectory_with(0, size) + NOISE * noise, "viscous", KNOWN)
        mode = find_mode(target, [TRUTH], noise_level=NOISE)
        assert check_fit(target, mode, 2 * np.pi / np.sqrt(K), 0)[0].verdict.startswith(verdict)
        form = strongest_form(target, mode, np.zeros(TIMES.size))
        assert (form.chance < 0.005) == bool(size)
        assert (form.words == FORMS[0].words) or not size


def test_responses_are_finite_until_friction_ends_the_motion() -> None:
    """Exact friction in closed form stops after four half cycles. The computation gives no warning."""
    known = {**KNOWN, "rest_angle": 0.0, "epsilon": 0.0}
    truth = {"mu_c": 0.5, "theta0": 0.21, "omega0": 0.0}
    y = with_coulomb(known | truth, TIMES)[:, 0]
    target = linear_target(TIMES, y, "coulomb", known)
    likelihood = find_mode(target, [truth], noise_level=NOISE).likelihood
    motion = likelihood.motions.motion(known | truth)
    assert np.abs(motion.y - y).max() < 1e-6
    finite = np.isfinite(responses_to_forms(likelihood, motion, known | truth))
    assert finite[:, TIMES * np.sqrt(K) < 4 * np.pi].all()
    assert not finite.all(axis=1).any()


def test_responses_are_the_residuals_of_a_fit_without_the_form() -> None:
    """Residuals of a viscous fit to a small further force, by SciPy: within 0.5 % in length, and nearly parallel.
    Control: the responses to other forms point elsewhere."""
    for number in range(len(FORMS)):
        size = 0.02 * ZETA * V
        target, mode = fitted(number, size)
        absorbed = orthonormal(tangents(target, mode).T)
        p = target.all_values(mode.z)
        responses = responses_to_forms(mode.likelihood, mode.likelihood.motions.motion(p), p)
        responses = size * (responses - responses @ absorbed @ absorbed.T)
        residual, lengths = mode.likelihood.residual(mode.z), np.linalg.norm(responses, axis=1)
        assert np.linalg.norm(residual) == pytest.approx(lengths[number], rel=5e-3)
        angles = 1 - responses @ residual / (lengths * np.linalg.norm(residual))
        assert angles[number] < 1e-3
        assert np.all(np.delete(angles, number) > 3 * angles[number])
