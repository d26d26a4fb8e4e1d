"""The whole of a case is one truth: least squares of the true law find it again, as far off as the noise says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import chi2

from validation.truth.motion import solved
from validation.truth.oscillator import COEFFICIENTS, LAWS, TERMS, Oscillator
from validation.truth.ratio import ratio_curve
from validation.truth.records import FAMILY, Case, case
from validation.truth.rivals import loss_rate
from validation.truth.trajectory import trajectory


def standardised(made: Case) -> float:
    """The fitted damping ratio at the middle amplitude less the true one, over its sd: a fit of the true law.

    The fitted ratio is that of the fitted motion, solved as the truth was; its sd is from the fit's covariance.
    """
    terms, names = made.damping.split("+"), LAWS[made.restoring]
    truth = np.array([made.parameters[n] for n in (*names, "theta0", "omega0")])
    truth = np.append(truth, [made.parameters[COEFFICIENTS[term]] for term in terms])
    t, y = made.signal.t, made.signal.y
    frequency, amplitude = 2 * np.pi * made.cycles / t[-1], made.amplitudes[1]
    within = int(np.ceil(72 * made.cycles / t.size))
    out = np.empty((t.size, 2))
    sizes = [max(abs(v), 0.1) for v in truth[: len(names)]]
    sizes += [amplitude, amplitude * frequency, *truth[len(names) + 2 :]]

    def oscillator_of(x: np.ndarray) -> Oscillator:
        found = (truth + sizes * x).tolist()
        damping = dict(zip(terms, found[len(names) + 2 :], strict=True))
        return Oscillator(made.restoring, dict(zip(names, found, strict=False)), damping)

    def residual(x: np.ndarray) -> np.ndarray:
        found, damping = truth + sizes * x, oscillator_of(x).damping
        law = np.append(found[: len(names)], np.zeros(3 - len(names)))
        coefficients = np.array([damping.get(term, 0.0) for term in TERMS])
        state = found[len(names) : len(names) + 2]
        number = list(LAWS).index(made.restoring)
        trajectory(number, law, coefficients, state[0], state[1], t[1] / within, within, out)
        return (out[:, 0] - y) / made.noise_sd

    def jacobian(x: np.ndarray) -> np.ndarray:
        steps = 1e-5 * np.eye(x.size)
        return np.column_stack([(residual(x + s) - residual(x - s)) / 2e-5 for s in steps])

    fit = least_squares(residual, np.zeros(truth.size), jacobian)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)[-len(terms) :, -len(terms) :]
    rates = np.array([float(loss_rate(term, amplitude, frequency)) for term in terms]) * sizes[-len(terms) :]
    fitted = oscillator_of(fit.x)
    release = made.ratio.amplitude[0] * np.sign(made.parameters["theta0"] - fitted.equilibrium())
    motion = solved(fitted, 1.02 * release, frequency, t[-1])
    found = ratio_curve(motion, fitted.potential())(amplitude)
    return (found - made.ratio(amplitude)) / float(np.sqrt(rates @ covariance @ rates))


@pytest.mark.slow
def test_a_fit_of_the_true_law_is_off_by_its_noise() -> None:
    """Σz² of 21 records is χ²: a false alarm in 1,000 on either side. Exact signs alone, as the fit has."""
    cases = (case(FAMILY, 7, n) for n in range(60))
    z = np.array(
        [standardised(made) for made, _ in zip((c for c in cases if not c.parameters["epsilon"]), range(21))]
    )
    assert chi2.ppf(5e-4, z.size) < np.sum(z**2) < chi2.ppf(1 - 5e-4, z.size)
    # The control: a truth that is off by three of its sd would be seen.
    assert np.sum((z + 3) ** 2) > chi2.ppf(1 - 5e-4, z.size)
