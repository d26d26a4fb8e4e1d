"""What a cycle takes of an amplitude under a damping term, shipped or a user's own, as a table over ln A.

By the work in a cycle of a harmonic motion, W, and Krylov and Bogoliubov's average, an amplitude falls as
dA/dt = -W/(2πωA) times the term's coefficient, per unit of inertia.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.special import ndtr, ndtri

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.types import InputError

GRID = np.linspace(-12.0, 1.5, 68)
"""ln(A/A_start) of the table: beyond, a loss goes on as a power of A."""
NOTHING = 1e-12
"""Of its largest value in the table a loss at least."""
SAME = 1e-6
"""Relative difference up to which two losses are the same."""
_REFERENCES = ("reference_velocity", "reference_amplitude")


@dataclass(frozen=True)
class Scale:
    """The amplitude at the start, in the unit in which a term's own parameters are, and the frequency in rad/s; 1 where
    they are not known: terms are then in units of these."""

    amplitude: float = 1.0
    frequency: float = 1.0


def parameter(one: FreeParameter, score: float, scale: Scale) -> float:
    """A parameter's value at a score that is normal before, also where its prior's own is folded."""
    prior = one.prior(scale.amplitude, scale.frequency)
    return float(prior.value(np.asarray(ndtri(0.5 + 0.5 * ndtr(score)) if prior.reflected else score)))


def parameters(term: DampingTerm, scores: tuple[float, ...], scale: Scale) -> dict[str, float]:
    """Of a term by name, at its scores."""
    return {one.name: parameter(one, z, scale) for one, z in zip(term.inferred, scores, strict=True)}


@lru_cache(maxsize=4096)
def log_loss(
    term: DampingTerm, scores: tuple[float, ...] = (), scale: Scale = Scale()
) -> Callable[[np.ndarray], np.ndarray]:
    """ln of the relative loss of amplitude in 1/s per unit of the coefficient, of ln(A/A_start).

    scores: of the term's parameters, see `parameter`. Raises InputError where it takes no energy.
    """
    found = losses(term, GRID, parameters(term, scores, scale), scale)
    most = float(np.max(found))
    if not (np.all(np.isfinite(found)) and most > 0):
        raise InputError(
            f"damping term {term.name!r}: a cycle's loss is {found[-1]:g} at the largest amplitude, "
            "and must be positive; mend its kernel or the bounds of its parameters"
        )
    kept = np.log(np.maximum(found, NOTHING * most))
    # Where a loss begins or ends at an amplitude, a spline would swing.
    table = CubicSpline(GRID, kept) if found.min() > NOTHING * most else PchipInterpolator(GRID, kept)
    ends = GRID[[0, -1]]
    slopes = table(ends, 1)

    def at(x: np.ndarray) -> np.ndarray:
        x = np.asarray(x, float)
        low, high = np.minimum(x - ends[0], 0.0), np.maximum(x - ends[1], 0.0)
        return table(np.clip(x, *ends)) + slopes[0] * low + slopes[1] * high

    return at


def losses(term: DampingTerm, x: np.ndarray, further: Mapping[str, float], scale: Scale) -> np.ndarray:
    """Relative losses of amplitude in 1/s per unit of the coefficient, (n,), at ln(A/A_start), (n,)."""
    a, omega = scale.amplitude, scale.frequency
    known = {"rest": 0.0, "reference_velocity": a * omega, "reference_amplitude": a, **further}
    amplitudes = a * np.exp(x)
    if not term.inferred and not set(term.given) & set(_REFERENCES):
        return np.array([omega * term.ratio_per_unit(float(one), omega) for one in amplitudes])
    return np.array(
        [term.work(float(one), omega, known) / (2 * np.pi * omega * one**2) for one in amplitudes]
    )


@lru_cache(maxsize=256)
def scales_needed(term: DampingTerm) -> tuple[bool, bool]:
    """Whether the shape of its loss depends on the unit of the amplitude, and on that of the frequency.

    One whose parameters scale with the amplitude and frequency of the record, as their priors do, needs neither.
    """
    x = np.array([-4.0, -2.0, 0.0])

    def shapes(scale: Scale) -> np.ndarray:
        found = []
        for scores in product((-1.0, 0.5), repeat=len(term.inferred)):
            one = losses(term, x, parameters(term, scores, scale), scale)
            found.append(one / max(float(one.max()), 1e-300))
        return np.array(found)

    here = shapes(Scale())
    return tuple(not np.allclose(here, shapes(s), SAME, SAME) for s in (Scale(0.037, 1.0), Scale(1.0, 41.0)))  # type: ignore[return-value]


def alike(a: DampingTerm, b: DampingTerm) -> bool:
    """Whether two terms lose alike at every amplitude, so that no envelope tells them apart."""
    if a.inferred or b.inferred or any(scales_needed(a)) or any(scales_needed(b)):
        return a is b
    x = np.array([-6.0, -4.0, -2.0, -1.0, 0.0])
    one, two = (losses(term, x, {}, Scale()) for term in (a, b))
    return bool(np.allclose(one / one[-1], two / two[-1], SAME, 0.0))
