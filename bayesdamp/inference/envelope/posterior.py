"""Draw decay rates and energy fractions from the posterior of a decay, and compute the likelihood of its damping rates.

The posterior is averaged over sums of damping terms, the possible noises and their scales, and the size τ and the
correlation length ℓ of the deviation from the damping law. The likelihood of the rates is used in joint fits of several
envelopes.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.deviation.linear import DampingLikelihood, damping_likelihood, grid_of
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, EnvelopeCandidate
from bayesdamp.numerics.weights import resample
from bayesdamp.physics.amplitude import linear_basis

RATE_DRAWS = 4000
"""Number of posterior draws of decay rates, in total for all sums of damping terms that are compared."""
SENSOR = 0.002
"""Relative standard deviation that is added to every decay rate, for errors that the record does not show: a nonlinear
detector and an inaccurate clock (conventional)."""
DRIFT = 0.1
"""Standard deviation, in dB, of an error that the record does not show: the drift or nonlinearity, over half of a
decay, of a detector with readings in dB. Conventional: makers of analysers state 0.1 to 0.2 dB."""
POINTS_ALONG = 257
"""Number of points along a fitted decay, evenly spaced in ln A (A is the amplitude), over which averages over the decay
are computed."""
LOSS_POINTS = 33
"""Number of amplitudes, evenly spaced in their logarithm, at which the decay rate of each term is tabulated
(`RateLikelihood.log_losses`)."""
WIDE_PRIOR = 3.0
"""Standard deviation of a normal prior of decay rates, as a multiple of the sum of the fitted rates. It is used to
merge the likelihoods of the rates for several noises into one Gaussian, and is divided out afterwards."""


@dataclass(frozen=True)
class RateDraws:
    """Posterior draws of decay rates; the first axis of all arrays is the draw. Draws of one candidate are consecutive.

    Attributes
    ----------
    at
        Decay rates in 1/s at the amplitudes that were passed to `draw_rates`, including the deviation from the law, (n,
        amplitudes).
    whole
        Mean (over time) decay rate in 1/s over the first half of the decrease in dB, according to the law without the
        deviation, (n,).
    energy
        Fraction of the energy dissipated during the decay by each term, (n, terms), in the order of the argument
        `terms` of `draw_rates`; 0 for terms that are not in the sum of the draw.
    deviation
        Root mean square over time of the relative deviation of the decay rate from the law, (n,).
    candidate
        Index of the fitted sum of damping terms from which each draw comes, in the argument `candidates` of
        `draw_rates`, (n,).
    rates
        For each term by name: its rates c_i in 1/s (see `DecayLaw`), only of the draws whose sum contains the term (so
        that lengths differ).
    """

    at: np.ndarray
    whole: np.ndarray
    energy: np.ndarray
    deviation: np.ndarray
    candidate: np.ndarray
    rates: Mapping[str, np.ndarray]


def draw_rates(
    blocks: Blocks,
    candidates: Sequence[EnvelopeCandidate],
    terms: Sequence[str],
    amplitudes: np.ndarray,
    rng: np.random.Generator,
    sensor: float = SENSOR,
    exact: bool = False,
) -> RateDraws:
    """Draw decay rates, energy fractions and deviations from the posterior of a decay.

    Parameters
    ----------
    blocks : Blocks
        The readings.
    candidates : sequence of EnvelopeCandidate
        The candidates (fitted models) of all sums of damping terms; each draw is from one of them, chosen by its
        posterior probability.
    terms : sequence of str
        Names of all terms, in the order of the columns of `RateDraws.energy`.
    amplitudes : ndarray, shape (m,)
        Values x = ln(A/A_ref) at which rates are drawn. Outside the range of the fit, the relative deviation from the
        law is that at the nearer end.
    rng : Generator
        Random number generator.
    sensor : float
        Relative standard deviation of every rate because of errors that the record does not show. All rates of a draw
        are multiplied by one random factor with the mean 1 and this standard deviation (`energy` and `deviation` do not
        change).
    exact : bool
        True to draw from the posterior under exact laws (no deviation); False to draw from the whole posterior.

    Returns
    -------
    RateDraws
        `RATE_DRAWS` draws.
    """
    log_z = np.array([(c.total_exact if exact else c.total) + c.log_share for c in candidates])
    counts = np.bincount(resample(log_z, RATE_DRAWS, rng), minlength=log_z.size)  # draws of each candidate
    s, names = blocks.t / blocks.duration, list(terms)
    ends = np.ones(POINTS_ALONG // 2 + 1)
    ends[[0, -1]] = 0.5
    parts = []
    for number in np.flatnonzero(counts).tolist():
        c, count = candidates[number], counts[number]
        rates, g = c.draws(exact, count, rng)
        # Averages over time are sums over points evenly spaced in x, with the times dt = dx/rate as weights: a decay
        # that is steep at first has too few readings there.
        x = np.linspace(c.fit[0], c.fit[-1], POINTS_ALONG)
        took = 1.0 / np.maximum(c.law.rate(x, c.rates), 1e-300)
        took[[0, -1]] *= 0.5
        shapes = c.law.shapes(x)  # (d, n): relative rate of each term along the decay
        # Mean rate: decrease of x divided by the time that it takes.
        whole = ends.sum() / ((1.0 / np.maximum(rates @ shapes[:, : ends.size], 1e-300)) @ ends)
        passed = np.interp(-amplitudes, -c.fit, s)
        at = rates @ c.law.shapes(amplitudes) * (1.0 + g @ linear_basis(passed, KNOTS).T)
        losses = rates * (shapes @ (np.exp(2.0 * x) * took))
        energy, by_term = np.zeros((count, len(names))), np.full((count, len(names)), np.nan)
        columns = [names.index(term) for term in c.terms]
        energy[:, columns] = losses / losses.sum(axis=1, keepdims=True)
        by_term[:, columns] = rates
        rms = np.sqrt(np.mean((g @ linear_basis(s, KNOTS).T) ** 2, axis=1))
        off = 1.0 + sensor * rng.standard_normal((count, 1))
        parts.append((at * off, whole * off[:, 0], energy, rms, by_term * off, np.full(count, number)))
    at, whole, energy, rms, rates, candidate = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = {term: column[np.isfinite(column)] for term, column in zip(terms, rates.T, strict=True)}
    return RateDraws(at, whole, energy, rms, candidate, known)


@dataclass(frozen=True, eq=False)
class RateLikelihood:
    """The likelihood of the d decay rates x of a sum of damping terms, given an envelope.

    There is one likelihood for each of c combinations of size (prior standard deviation) and correlation length of the
    deviation from the damping law. Each is the Gaussian exp(log + xᵀ slope − xᵀ information x / 2). It contains neither
    the prior of x nor that of size and length; the start, the noise floor, the noise and the deviation are integrated
    out. x is the vector of the rates c_i of the `DecayLaw`: term i causes the decay rate c_i s_i, where the shape s_i
    depends on the amplitude.

    Attributes
    ----------
    log
        Constant in nats, (c,); sizes and lengths are in the order of `grid_of`.
    slope, information
        Coefficients for rates in 1/s: in s, (c, d), and in s², (c, d, d).
    reference
        ln of the reference amplitude in the record's unit (for powers, of their root); if the unit is dB, ln of its
        ratio to the amplitude at 0 dB.
    log_amplitudes
        ln of n amplitudes in the unit of `reference`, (n,), increasing.
    log_losses
        ln of the shape s_i of each term at these amplitudes, (d, n).
    omega
        Angular frequency in rad/s; None if it is not known.
    duration
        Duration of the decay in s.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    reference: float
    log_amplitudes: np.ndarray
    log_losses: np.ndarray
    omega: float | None
    duration: float

    def in_scores(self, log_amplitude: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the likelihood as a function of scores: the terms' decay rates at one amplitude, divided by a unit.

        For several records with the same amplitude and unit, the scores are the same unknowns, so that the records can
        be fitted jointly.

        Parameters
        ----------
        log_amplitude
            ln of the amplitude, in the unit of `reference`. Outside of the tabulated amplitudes each rate is
            extrapolated as a power of the amplitude.
        rate
            The unit: the rate in 1/s that corresponds to a score of 1.

        Returns
        -------
        log, slope, information
            Coefficients of the likelihood for the scores, as in the class: (c,), (c, d) and (c, d, d).
        """
        x, y = self.log_amplitudes, self.log_losses
        i = int(np.clip(np.searchsorted(x, log_amplitude) - 1, 0, x.size - 2))
        loss = y[:, i] + (log_amplitude - x[i]) * (y[:, i + 1] - y[:, i]) / (x[i + 1] - x[i])
        factor = rate * np.exp(-loss)
        return self.log, self.slope * factor, self.information * factor * factor[:, None]


def likelihood_of(candidate: EnvelopeCandidate, blocks: Blocks, reference: float) -> RateLikelihood:
    """Compute the likelihood of the decay rates of a sum of damping terms, given an envelope.

    Parameters
    ----------
    candidate
        The fitted sum; its terms must not have parameters besides their coefficients.
    blocks
        The readings with their possible noises.
    reference
        ln of the reference amplitude, as in `Decay.reference`.

    Returns
    -------
    RateLikelihood
        The likelihood, with the noises integrated out.
    """
    scale = WIDE_PRIOR * float(candidate.rates.sum()) / candidate.unit
    about = candidate.about
    of_scores = damping_likelihood(about.normals, np.arange(len(candidate.terms)), about.log_sizes)
    log, slope, information = merge_noises(of_scores, grid_of(KNOTS, phases=False).log_prior.size, scale)
    slope, information = slope / candidate.unit, information / candidate.unit**2
    x = np.linspace(float(blocks.x.min()), blocks.ends[0], LOSS_POINTS)
    losses = np.log(np.maximum(candidate.law.shapes(x), 1e-300))
    return RateLikelihood(
        log, slope, information, reference, x + reference, losses, blocks.frequency, blocks.duration
    )


def merge_noises(
    likelihood: DampingLikelihood, sizes: int, sd: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge the likelihoods of decay rates for several possible noises into one Gaussian.

    This is done for each size (prior sd) and correlation length of the deviation of the decay rate from its law. A
    mixture of Gaussians is not a Gaussian: the result has, under a wide normal prior, the same evidence, mean and
    covariance as the mixture. The prior is then divided out. Negative eigenvalues of the resulting information are set
    to 0.

    Parameters
    ----------
    likelihood
        Likelihoods of d rates in a common unit (scores). They are ordered by noise, and for each noise by the c
        combinations of size and correlation length.
    sizes
        Number c of combinations of size and correlation length.
    sd
        Standard deviation of the wide prior, in the unit of the scores.

    Returns
    -------
    log, slope, information
        Coefficients of the merged likelihood exp(log + xᵀ slope − xᵀ information x / 2), (c,), (c, d) and (c, d, d).
    """
    d = likelihood.slope.shape[1]
    wide = np.eye(d) / sd**2
    covariance = np.linalg.inv(likelihood.information + wide)
    mean = (covariance @ likelihood.slope[:, :, None])[:, :, 0]
    log = likelihood.log + 0.5 * np.sum(likelihood.slope * mean, axis=1)
    log = log + 0.5 * np.linalg.slogdet(covariance)[1] - d * np.log(sd)
    log = log.reshape(-1, sizes)
    total = logsumexp(log, axis=0)
    weights = np.exp(log - total)
    mean, covariance = mean.reshape(-1, sizes, d), covariance.reshape(-1, sizes, d, d)
    centre = np.einsum("np,npi->pi", weights, mean)
    off = mean - centre
    spread = np.einsum("np,npij->pij", weights, covariance) + np.einsum("np,npi,npj->pij", weights, off, off)
    precision = np.linalg.inv(spread)
    slope = (precision @ centre[:, :, None])[:, :, 0]
    gained, axes = np.linalg.eigh(precision - wide)
    information = (axes * np.maximum(gained, 0.0)[:, None, :]) @ np.swapaxes(axes, 1, 2)
    log = total - 0.5 * np.sum(slope * centre, axis=1)
    return log - 0.5 * np.linalg.slogdet(spread)[1] + d * np.log(sd), slope, information
