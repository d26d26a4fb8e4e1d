"""Decay of an amplitude under sums of damping terms and under a power law, in closed form.

Averaged over a cycle (Krylov & Bogoliubov 1937; Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3) an oscillation of
frequency ω loses amplitude as dA/dt = -(ζA + 2μ_c/(πω) + 4μ_q ω A²/(3π)). With x = ln(A/A_ref) each term is a rate in
1/s at the reference amplitude times a power of it, dx/dt = -Σ c_i exp((p_i - 1) x), with p = 1, 0 and 2.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

POWERS: Mapping[str, float] = {"viscous": 1.0, "coulomb": 0.0, "quadratic": 2.0}
"""Power of the amplitude that a term's loss goes with; in the order in which sums name them."""
SUMS: tuple[tuple[str, ...], ...] = (
    ("viscous",),
    ("coulomb",),
    ("quadratic",),
    ("viscous", "coulomb"),
    ("viscous", "quadratic"),
    ("coulomb", "quadratic"),
    ("viscous", "coulomb", "quadratic"),
)
RESTED = -60.0
"""ln(A/A_ref) of what has come to rest."""
EXPONENTS = -1.0, 3.0
"""Powers of the amplitude that a loss may go with: below 0 is friction that rises towards rest."""
NEAR_VISCOUS = 1e-4
"""Of the exponent: nearer to 1 its derivative is taken from a series."""
_NEAR_ONE = 1e-6
_LINEAR = 1e-6


def rate(x: np.ndarray, terms: Sequence[str], rates: np.ndarray) -> np.ndarray:
    """-dx/dt in 1/s at x = ln(A/A_ref), shape (n,), of terms with rates c_i at the reference amplitude."""
    return sum(
        (c * np.exp((POWERS[term] - 1.0) * x) for term, c in zip(terms, rates, strict=True)), np.zeros_like(x)
    )


def decay(t: np.ndarray, x0: float, terms: Sequence[str], rates: np.ndarray) -> np.ndarray:
    """x = ln(A/A_ref) at times t (s, from 0), shape (n,), that starts at x0; RESTED from where it comes to rest.

    The sum of all three is a Riccati equation with constant coefficients, whose solution is a fraction in tanh or tan.
    """
    by_term = dict(zip(terms, rates, strict=True))
    c1, c0, c2 = (float(by_term.get(term, 0.0)) for term in POWERS)
    start = np.exp(x0)
    half = 0.5 * c1
    discriminant = half * half - c0 * c2
    k = np.sqrt(abs(discriminant))
    kt = k * t
    if discriminant < 0:
        # Amplitude passes zero before tan does infinity: from there on it has come to rest.
        late = kt >= 0.5 * np.pi
        grown = np.where(late, np.inf, np.tan(np.where(late, 0.0, kt)) / k)
    else:
        grown = np.where(np.abs(kt) > _LINEAR, np.tanh(kt) / max(k, 1e-300), t)
    with np.errstate(invalid="ignore", divide="ignore"):
        amplitude = (start - grown * (half * start + c0)) / (1.0 + grown * (half + c2 * start))
    if c0 == 0.0 and c2 == 0.0:
        return np.maximum(x0 - c1 * t, RESTED)
    if c0 == 0.0 and c1 > 0.0:  # without the difference of nearly equal numbers that tanh leaves late
        return np.maximum(x0 - c1 * t - np.log1p(-c2 * start * np.expm1(-c1 * t) / c1), RESTED)
    if c2 == 0.0 and c1 > 0.0:
        left = start * np.exp(-c1 * t) + c0 * np.expm1(-c1 * t) / c1
        amplitude = left
    return np.log(np.where(amplitude > np.exp(RESTED), amplitude, np.exp(RESTED)))


def power_decay(t: np.ndarray, x0: float, log_rate: float, power: float) -> np.ndarray:
    """x at times t under dA/dt = -c A^p alone, its rate at the reference amplitude exp(log_rate) in 1/s."""
    q = power - 1.0
    speed = np.exp(log_rate + q * x0)
    if abs(q) < _NEAR_ONE:
        return np.maximum(x0 - speed * t, RESTED)
    inside = q * speed * t
    with np.errstate(invalid="ignore", divide="ignore"):
        x = x0 - np.log1p(inside) / q
    return np.where((inside > -1.0) & (x > RESTED), x, RESTED)


def power_slopes(t: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Derivatives of `power_decay`'s x by p: x at the start, ln of the rate there, the exponent; shape (n, 3)."""
    q, passed = p[2] - 1.0, np.exp(p[1]) * t
    left = np.maximum(1.0 + q * passed, 1e-12)  # 0 where it comes to rest, of which nothing is seen
    if abs(q) < NEAR_VISCOUS:
        bend = passed * passed * (0.5 - 2.0 / 3.0 * q * passed)
    else:
        bend = (np.log(left) / q - passed / left) / q
    return np.column_stack([np.ones_like(t), -passed / left, bend])


def coefficients(
    terms: Sequence[str], rates: np.ndarray, reference: float, omega: float | None
) -> list[tuple[str, np.ndarray, str]]:
    """(name, values, exponent of the amplitude's unit) of each term's coefficient.

    rates: shape (terms, ...), in 1/s at the reference amplitude. With omega (rad/s) they are `zeta`, `mu_c` and `mu_q`
    of the equation of motion; without, the losses of amplitude in it: c A (1/s), c, c A².
    """
    found = []
    for term, c in zip(terms, rates, strict=True):
        if term == "viscous":
            found.append(("zeta", c, "1/s"))
        elif term == "coulomb":
            loss = c * reference
            found.append(
                ("loss_c", loss, "{}/s") if omega is None else ("mu_c", loss * np.pi * omega / 2, "{}/s²")
            )
        else:
            loss = c / reference
            found.append(
                ("loss_q", loss, "1/({} s)")
                if omega is None
                else ("mu_q", loss * 3 * np.pi / (4 * omega), "1/{}")
            )
    return found
