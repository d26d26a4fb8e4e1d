"""Tabulate over ln A what a cycle takes of an amplitude under any damping term, shipped or a user's own.

With the work W in a cycle of a harmonic motion and Krylov and Bogoliubov's average, an amplitude falls as
dA/dt = -W/(2πωA) times the term's coefficient, per unit of inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
import scipy  # loads its modules when they are used
from scipy.special import ndtr, ndtri

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.types import InputError

GRID = np.linspace(-12.0, 1.5, 68)
"""ln(A/A_start) of the table; beyond it a loss continues as a power of A."""
NOTHING = 1e-12
"""Least loss as a share of the largest one in the table."""
SAME = 1e-6
"""Relative difference up to which two losses are the same."""
_REFERENCES = ("reference_velocity", "reference_amplitude")


@dataclass(frozen=True)
class Scale:
    """Amplitude at the start, in the unit of a term's own parameters, and frequency in rad/s.

    They are 1 where they are not known; terms are then in units of these.
    """

    amplitude: float = 1.0
    frequency: float = 1.0


def parameter(p: FreeParameter, score: float, scale: Scale) -> float:
    """Return a parameter's value at a score with a normal prior, also where the prior's own score is folded."""
    prior = p.prior(scale.amplitude, scale.frequency)
    return float(prior.value(np.asarray(ndtri(0.5 + 0.5 * ndtr(score)) if prior.reflected else score)))


def parameters(term: DampingTerm, scores: tuple[float, ...], scale: Scale) -> dict[str, float]:
    """Return a term's own parameters by name, at its scores."""
    return {p.name: parameter(p, z, scale) for p, z in zip(term.inferred, scores, strict=True)}


@lru_cache(maxsize=4096)
def log_loss(
    term: DampingTerm, scores: tuple[float, ...] = (), scale: Scale = Scale()
) -> Callable[[np.ndarray], np.ndarray]:
    """Return ln of the relative loss of amplitude in 1/s per unit of the coefficient, as a function of ln(A/A_start).

    Parameters
    ----------
    term
        The damping term.
    scores
        Scores of the term's parameters, see `parameter`.
    scale
        Amplitude and frequency at the start.

    Raises
    ------
    InputError
        Where the term takes no energy.
    """
    loss = losses(term, GRID, parameters(term, scores, scale), scale)
    most = float(np.max(loss))
    if not (np.all(np.isfinite(loss)) and most > 0):
        raise InputError(
            f"damping term {term.name!r}: a cycle's loss is {loss[-1]:g} at the largest amplitude, "
            "and must be positive; correct its kernel or the bounds of its parameters"
        )
    log = np.log(np.maximum(loss, NOTHING * most))
    # Where a loss begins or ends at an amplitude, a spline would oscillate.
    table = (
        scipy.interpolate.CubicSpline(GRID, log)
        if loss.min() > NOTHING * most
        else scipy.interpolate.PchipInterpolator(GRID, log)
    )
    ends = GRID[[0, -1]]
    slopes = table(ends, 1)

    def at(x: np.ndarray) -> np.ndarray:
        x = np.asarray(x, float)
        low, high = np.minimum(x - ends[0], 0.0), np.maximum(x - ends[1], 0.0)
        return table(np.clip(x, *ends)) + slopes[0] * low + slopes[1] * high

    return at


def losses(term: DampingTerm, x: np.ndarray, further: Mapping[str, float], scale: Scale) -> np.ndarray:
    """Return relative losses of amplitude in 1/s per unit of the coefficient, (n,), at ln(A/A_start), (n,)."""
    a, omega = scale.amplitude, scale.frequency
    known = {"rest": 0.0, "reference_velocity": a * omega, "reference_amplitude": a, **further}
    amplitudes = a * np.exp(x)
    if not term.inferred and not set(term.given) & set(_REFERENCES):
        return np.array([omega * term.ratio_per_unit(float(at), omega) for at in amplitudes])
    return np.array([term.work(float(at), omega, known) / (2 * np.pi * omega * at**2) for at in amplitudes])


@lru_cache(maxsize=256)
def scales_needed(term: DampingTerm) -> tuple[bool, bool]:
    """Return whether the shape of a term's loss depends on the unit of the amplitude, and on that of the frequency.

    A term whose parameters scale with the amplitude and frequency of the record, as their priors do, needs neither.
    """
    x = np.array([-4.0, -2.0, 0.0])

    def shapes(scale: Scale) -> np.ndarray:
        rows = []
        for scores in product((-1.0, 0.5), repeat=len(term.inferred)):
            loss = losses(term, x, parameters(term, scores, scale), scale)
            rows.append(loss / max(float(loss.max()), 1e-300))
        return np.array(rows)

    here = shapes(Scale())
    return tuple(not np.allclose(here, shapes(s), SAME, SAME) for s in (Scale(0.037, 1.0), Scale(1.0, 41.0)))  # type: ignore[return-value]


def alike(a: DampingTerm, b: DampingTerm) -> bool:
    """Return whether two terms lose the same at every amplitude, so that an envelope cannot distinguish them."""
    if a.inferred or b.inferred or any(scales_needed(a)) or any(scales_needed(b)):
        return a is b
    x = np.array([-6.0, -4.0, -2.0, -1.0, 0.0])
    first, second = (losses(term, x, {}, Scale()) for term in (a, b))
    return bool(np.allclose(first / first[-1], second / second[-1], SAME, 0.0))
