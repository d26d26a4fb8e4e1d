"""The posterior of a decay as an answer needs it: draws of its quantities, and the likelihood of its damping rates.

Draws are from the mixture over damping sums, noise, scale, τ and ℓ. The likelihood of the rates alone is for an answer
over several records.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.deviation.linear import DampingLikelihood, damping_likelihood, grid_of
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, EnvelopeCandidate
from bayesdamp.numerics.weights import normalise
from bayesdamp.physics.amplitude import hats

DRAWS = 4000
SENSOR = 0.002
"""Relative sd of any rate that no record determines: the linearity of a detector, and its clock."""
DRIFT = 0.1
"""dB (sd) by which the gain of a detector that reads dB drifts, or bends, over half of a decay without leaving a trace:
conventional, makers of analysers state 0.1 to 0.2."""
ALONG = 257
"""Points of a fit, evenly spaced in ln A, over which means are taken."""
LOSSES = 33
"""Amplitudes, evenly spaced in their logarithm, at which the loss of each term is stored."""
WIDE = 3.0
"""Standard deviation, in sums of the fitted rates, of the normal prior under which the likelihoods of several noises
are merged: wide compared with every rate that the record allows, and removed again."""


@dataclass(frozen=True)
class RateDraws:
    """Posterior draws, one row each.

    Attributes
    ----------
    at
        Rates in 1/s at the amplitudes, with the law's deviation, (n, amplitudes).
    whole
        Rates in 1/s by the law, mean over the first half of the fall in dB, (n,): those of another run, up to its own
        deviation.
    energy
        Share of the energy that each term takes, (n, terms).
    deviation
        Root mean square deviation, (n,).
    candidate
        Index of the candidate, (n,).
    rates
        Rates at the reference amplitude by term, of the draws that have it.
    """

    at: np.ndarray
    whole: np.ndarray
    energy: np.ndarray
    deviation: np.ndarray
    candidate: np.ndarray
    rates: Mapping[str, np.ndarray]


def draw(
    blocks: Blocks,
    candidates: Sequence[EnvelopeCandidate],
    terms: Sequence[str],
    amplitudes: np.ndarray,
    rng: np.random.Generator,
    sensor: float = SENSOR,
    exact: bool = False,
) -> RateDraws:
    """Draw the quantities in an answer.

    Parameters
    ----------
    blocks : Blocks
        The readings.
    candidates : sequence of Candidate
        Of all sums.
    terms : sequence of str
        Of all sums.
    amplitudes : ndarray
        x = ln(A/A_ref) at which rates are wanted.
    rng : Generator
        Source of random numbers.
    sensor : float
        Relative sd of any rate.
    exact : bool
        Whether the law is taken to hold exactly.
    """
    log_z = np.array([(c.total_exact if exact else c.total) + c.log_share for c in candidates])
    # Systematic resampling distributes the draws (Kitagawa 1996).
    places = (rng.random() + np.arange(DRAWS)) / DRAWS
    counts = np.bincount(np.searchsorted(np.cumsum(normalise(log_z))[:-1], places), minlength=log_z.size)
    s, names = blocks.t / blocks.duration, list(terms)
    ends = np.ones(ALONG // 2 + 1)
    ends[[0, -1]] = 0.5
    parts = []
    for place in np.flatnonzero(counts).tolist():
        c, count = candidates[place], counts[place]
        rates, g = c.draws(exact, count, rng)
        # Along the fit time passes as dx/f: a decay that is steep at first has few readings there.
        x = np.linspace(c.fit[0], c.fit[-1], ALONG)
        took = 1.0 / np.maximum(c.law.rate(x, c.rates), 1e-300)
        took[[0, -1]] *= 0.5
        shapes = c.law.shapes(x)  # (d, n): of each term's rate over the record
        # The fall over the time that it takes.
        whole = ends.sum() / ((1.0 / np.maximum(rates @ shapes[:, : ends.size], 1e-300)) @ ends)
        passed = np.interp(-amplitudes, -c.fit, s)
        at = rates @ c.law.shapes(amplitudes) * (1.0 + g @ hats(passed, KNOTS).T)
        losses = rates * (shapes @ (np.exp(2.0 * x) * took))
        energy, by_term = np.zeros((count, len(names))), np.full((count, len(names)), np.nan)
        columns = [names.index(term) for term in c.terms]
        energy[:, columns] = losses / losses.sum(axis=1, keepdims=True)
        by_term[:, columns] = rates
        rms = np.sqrt(np.mean((g @ hats(s, KNOTS).T) ** 2, axis=1))
        off = 1.0 + sensor * rng.standard_normal((count, 1))
        parts.append((at * off, whole * off[:, 0], energy, rms, by_term * off, np.full(count, place)))
    at, whole, energy, rms, rates, candidate = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = {term: column[np.isfinite(column)] for term, column in zip(terms, rates.T, strict=True)}
    return RateDraws(at, whole, energy, rms, candidate, known)


@dataclass(frozen=True, eq=False)
class RateLikelihood:
    """Likelihood of the rates x of a damping sum under each of c sizes and lengths of the deviation.

    It is exp(log + xᵀ slope − xᵀ information x / 2), everything else integrated out: the start, the floor, the noise
    and the deviation itself. It contains no prior of x and none of the deviation's size and length.

    Attributes
    ----------
    log
        In nats, (c,), in the order of `grid_of`.
    slope, information
        Of the rates at the reference amplitude, in s, (c, d), and in s², (c, d, d).
    reference
        ln of the reference amplitude in the record's unit (of its ratio to 1, where that unit is dB).
    log_amplitudes
        ln of amplitudes in that unit, (n,), rising.
    log_losses
        ln of each term's relative loss at these over that at the reference amplitude, (d, n).
    unit
        Unit of the record's readings.
    omega
        Frequency in rad/s, None where it is not known.
    duration
        Duration of the decay in s.
    """

    log: np.ndarray
    slope: np.ndarray
    information: np.ndarray
    reference: float
    log_amplitudes: np.ndarray
    log_losses: np.ndarray
    unit: str
    omega: float | None
    duration: float

    def in_scores(self, log_amplitude: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the likelihood in coordinates that several records can share.

        Parameters
        ----------
        log_amplitude
            ln of the amplitude of the rates, in the record's unit. Beyond the stored amplitudes each loss is extended
            as a power of the amplitude.
        rate
            Rate in 1/s at a score of 1.

        Returns
        -------
        log, slope, information
            Of the scores, (c,), (c, d) and (c, d, d).
        """
        x, y = self.log_amplitudes, self.log_losses
        i = int(np.clip(np.searchsorted(x, log_amplitude) - 1, 0, x.size - 2))
        loss = y[:, i] + (log_amplitude - x[i]) * (y[:, i + 1] - y[:, i]) / (x[i + 1] - x[i])
        factor = rate * np.exp(-loss)
        return self.log, self.slope * factor, self.information * factor * factor[:, None]


def likelihood_of(
    candidate: EnvelopeCandidate, blocks: Blocks, reference: float, unit: str
) -> RateLikelihood:
    """Compute the likelihood of a candidate's rates.

    Parameters
    ----------
    candidate
        A weighed sum without further parameters.
    blocks
        The readings.
    reference
        ln of their reference amplitude in the record's unit.
    unit
        Unit of the record's readings.
    """
    scale = WIDE * float(candidate.rates.sum()) / candidate.unit
    about = candidate.about
    of_scores = damping_likelihood(about.normals, np.arange(len(candidate.terms)), about.log_sizes)
    log, slope, information = merged(of_scores, grid_of(KNOTS, phases=False).log_prior.size, scale)
    slope, information = slope / candidate.unit, information / candidate.unit**2
    x = np.linspace(float(blocks.x.min()), blocks.ends[0], LOSSES)
    shapes = candidate.law.shapes(np.append(x, 0.0))
    losses = np.log(np.maximum(shapes[:, :-1] / shapes[:, -1:], 1e-300))
    return RateLikelihood(
        log, slope, information, reference, x + reference, losses, unit, blocks.frequency, blocks.duration
    )


def merged(likelihood: DampingLikelihood, sizes: int, sd: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Merge the likelihoods under all noises into one Gaussian for each size and length of the deviation.

    It has the evidence, the mean and the covariance of their mixture under a wide normal prior.

    Parameters
    ----------
    likelihood
        Likelihood of the rates' scores under all noises, the size and length of the deviation running fastest.
    sizes
        Number of sizes and lengths, c.
    sd
        Standard deviation of the wide prior.

    Returns
    -------
    log, slope, information
        Of the scores, (c,), (c, d) and (c, d, d).
    """
    d = likelihood.slope.shape[1]
    wide = np.eye(d) / sd**2
    covariance = np.linalg.inv(likelihood.information + wide)
    mean = (covariance @ likelihood.slope[:, :, None])[:, :, 0]
    log = likelihood.log + 0.5 * np.sum(likelihood.slope * mean, axis=1)
    log = log + 0.5 * np.linalg.slogdet(covariance)[1] - d * np.log(sd)
    log = log.reshape(-1, sizes)
    total = logsumexp(log, axis=0)
    share = np.exp(log - total)
    mean, covariance = mean.reshape(-1, sizes, d), covariance.reshape(-1, sizes, d, d)
    centre = np.einsum("np,npi->pi", share, mean)
    off = mean - centre
    spread = np.einsum("np,npij->pij", share, covariance) + np.einsum("np,npi,npj->pij", share, off, off)
    precision = np.linalg.inv(spread)
    slope = (precision @ centre[:, :, None])[:, :, 0]
    gained, axes = np.linalg.eigh(precision - wide)
    information = (axes * np.maximum(gained, 0.0)[:, None, :]) @ np.swapaxes(axes, 1, 2)
    log = total - 0.5 * np.sum(slope * centre, axis=1)
    return log - 0.5 * np.linalg.slogdet(spread)[1] + d * np.log(sd), slope, information
