"""Draws of the quantities in an answer, from the mixture over damping sums, noise, scale, τ and ℓ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, Candidate
from bayesdamp.physics.amplitude.solver import hats

DRAWS = 4000
SENSOR = 0.002
"""Relative sd of any rate that no record determines: the linearity of a detector, and its clock."""
DRIFT = 0.1
"""dB (sd) by which the gain of a detector that reads dB drifts, or bends, over half of a decay without leaving a trace:
conventional, makers of analysers state 0.1 to 0.2."""
ALONG = 257
"""Points of a fit, evenly spaced in ln A, over which means are taken."""


@dataclass(frozen=True)
class Draws:
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
    candidates: Sequence[Candidate],
    terms: Sequence[str],
    amplitudes: np.ndarray,
    rng: np.random.Generator,
    sensor: float = SENSOR,
    exact: bool = False,
) -> Draws:
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
    probability = np.exp(log_z - log_z.max())
    # Systematic resampling distributes the draws (Kitagawa 1996).
    at = (rng.random() + np.arange(DRAWS)) / DRAWS
    shares = np.cumsum(probability / probability.sum())
    counts = np.bincount(np.searchsorted(shares[:-1], at), minlength=probability.size)
    parts = [
        (*_draws(blocks, c, *c.draws(exact, n, rng), terms, amplitudes, sensor, rng), np.full(n, i))
        for i, (c, n) in enumerate(zip(candidates, counts, strict=True))
        if n
    ]
    at, whole, energy, rms, rates, candidate = (np.concatenate(column) for column in zip(*parts, strict=True))
    known = {term: column[np.isfinite(column)] for term, column in zip(terms, rates.T, strict=True)}
    return Draws(at, whole, energy, rms, candidate, known)


def _draws(
    blocks: Blocks,
    c: Candidate,
    rates: np.ndarray,
    g: np.ndarray,
    names: Sequence[str],
    amplitudes: np.ndarray,
    sensor: float,
    rng: np.random.Generator,
) -> tuple[np.ndarray, ...]:
    """Return the quantities of one candidate's draws of rates, (n, d), and of the deviation at the knots."""
    count = len(rates)
    s = blocks.t / blocks.duration
    # Along the fit time passes as dx/f: a decay that is steep at first has few readings there.
    x = np.linspace(c.fit[0], c.fit[-1], ALONG)
    took = 1.0 / np.maximum(c.law.rate(x, c.rates), 1e-300)
    took[[0, -1]] *= 0.5
    shapes = c.law.shapes(x)  # (d, n): of each term's rate over the record
    half = slice(0, ALONG // 2 + 1)
    ends = np.ones(ALONG // 2 + 1)
    ends[[0, -1]] = 0.5
    # The fall over the time that it takes.
    whole = ends.sum() / ((1.0 / np.maximum(rates @ shapes[:, half], 1e-300)) @ ends)
    passed = np.interp(-amplitudes, -c.fit, s)
    at = rates @ c.law.shapes(amplitudes) * (1.0 + g @ hats(passed, KNOTS).T)
    losses = rates * (shapes @ (np.exp(2.0 * x) * took))
    energy, terms = np.zeros((count, len(names))), np.full((count, len(names)), np.nan)
    places = [list(names).index(term) for term in c.terms]
    energy[:, places] = losses / losses.sum(axis=1, keepdims=True)
    terms[:, places] = rates
    rms = np.sqrt(np.mean((g @ hats(s, KNOTS).T) ** 2, axis=1))
    off = 1.0 + sensor * rng.standard_normal((count, 1))
    return at * off, whole * off[:, 0], energy, rms, terms * off
