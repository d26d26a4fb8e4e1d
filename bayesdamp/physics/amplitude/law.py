"""A sum of damping terms as a decay: in closed form, or from tables of what each term takes of an amplitude."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.physics.amplitude.laws import POWERS, decay, power_decay, power_slopes

PANELS = 200
"""Of the amplitude's logarithm, between which time is integrated: it is then right to 1e-8 of what passes."""
LEAST = 1e-30
"""Of the rate in 1/s: an amplitude that nothing damps stays."""
_GAUSS = np.array([-1.0, 1.0]) / np.sqrt(3.0)

Shape = Callable[[np.ndarray], np.ndarray]
"""A term's loss at x = ln(A/A_ref) relative to that at x = 0, of the amplitude itself."""


class Law(ABC):
    """dx/dt = -Σ c_i s_i(x) of x = ln(A/A_ref)."""

    terms: tuple[str, ...]

    @abstractmethod
    def shapes(self, x: np.ndarray) -> np.ndarray:
        """s_i at x (n,), shape (terms, n)."""

    @abstractmethod
    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """x at times t (s, from 0), shape (n,), from x0 with these rates c_i (1/s, not negative)."""

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """-dx/dt in 1/s at x, shape (n,)."""
        return rates @ self.shapes(x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """Derivatives of the decay x at t by the rates, (n, terms). step: of a rate that is small, in 1/s."""
        columns = []
        for i in range(len(rates)):
            up, down = rates.copy(), rates.copy()
            up[i] += step
            down[i] = max(0.0, rates[i] - step)
            columns.append((self.decay(t, x0, up) - self.decay(t, x0, down)) / (up[i] - down[i]))
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class ClosedForm(Law):
    """Of viscous, Coulomb and quadratic damping."""

    terms: tuple[str, ...]

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """exp((p_i - 1) x)."""
        return np.exp(np.array([[POWERS[term] - 1.0] for term in self.terms]) * x)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """See `laws.decay`."""
        return decay(t, x0, self.terms, rates)


@dataclass(frozen=True)
class PowerLaw(Law):
    """One power p of the amplitude, dA/dt = -c A^p; its parameters are ln of the rate c in 1/s at A_ref, and p."""

    terms: tuple[str, ...] = ("log_rate", "exponent")

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Raises NotImplementedError: its shape is not known beforehand."""
        raise NotImplementedError

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """See `laws.power_decay`."""
        return power_decay(t, x0, float(rates[0]), float(rates[1]))

    def rate(self, x: np.ndarray, rates: np.ndarray) -> np.ndarray:
        """-dx/dt in 1/s at x, shape (n,)."""
        return np.exp(rates[0] + (rates[1] - 1.0) * x)

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """See `laws.power_slopes`, which has the rate at the start."""
        own = power_slopes(t, np.array([x0, rates[0] + (rates[1] - 1.0) * x0, rates[1]]))
        return np.column_stack([own[:, 1], own[:, 2] + x0 * own[:, 1]])


@dataclass(frozen=True)
class Tabled(Law):
    """Of any terms, whose shapes are known between `low` and `high`; beyond, the sum goes on as a power of A."""

    terms: tuple[str, ...]
    each: tuple[Shape, ...]
    low: float
    high: float

    def shapes(self, x: np.ndarray) -> np.ndarray:
        """Of each term."""
        return np.stack([shape(x) for shape in self.each])

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x of the panels' ends, falling, and shapes there and at Gauss and Legendre's two points of each panel."""
        x = np.linspace(self.high, self.low, PANELS + 1)
        middle, half = 0.5 * (x[1:] + x[:-1]), 0.5 * (x[0] - x[1])
        inside = (middle[:, None] + half * _GAUSS).ravel()
        return x, self.shapes(x), self.shapes(inside)

    def decay(self, t: np.ndarray, x0: float, rates: np.ndarray) -> np.ndarray:
        """t(x) = ∫ dx/f by quadrature, inverted by cubics of its nodes and slopes."""
        x, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, LEAST)
        slow = 1.0 / np.maximum(rates @ inside, LEAST)
        took = 0.5 * (x[0] - x[1]) * slow.reshape(-1, 2).sum(axis=1)
        passed = np.concatenate([[0.0], np.cumsum(took)])
        power = [
            float(np.diff(np.log(speed[side]))[0] / np.diff(x[side])[0])
            for side in (slice(2), slice(-2, None))
        ]
        if x0 > x[0]:
            begun = -_between(x0 - x[0], speed[0], power[0])
        elif x0 < x[-1]:
            begun = passed[-1] + _between(x[-1] - x0, speed[-1] * np.exp(power[1] * (x0 - x[-1])), power[1])
        else:
            begun = float(_cubic(np.array([x0]), x[::-1], passed[::-1], -1.0 / speed[::-1])[0])
        at = begun + t
        found = _cubic(np.clip(at, passed[0], passed[-1]), passed, x, -speed)
        for outside, place, since in ((at < 0.0, 0, at), (at > passed[-1], -1, at - passed[-1])):
            if outside.any():
                q = power[place]
                found[outside] = power_decay(
                    since[outside], float(x[place]), float(np.log(speed[place]) - q * x[place]), q + 1.0
                )
        return found

    def slopes(self, t: np.ndarray, x: np.ndarray, x0: float, rates: np.ndarray, step: float) -> np.ndarray:
        """By quadrature: a rate that is larger passes the amplitude on f ∫ s_i/f dt further."""
        if rates.sum() < step:  # an amplitude that stays passes nothing
            rates = np.maximum(rates, step)
            x = self.decay(t, x0, rates)
        nodes, ends, inside = self._nodes
        speed = np.maximum(rates @ ends, LEAST)
        slow = inside / np.maximum(rates @ inside, LEAST) ** 2
        each = 0.5 * (nodes[0] - nodes[1]) * slow.reshape(len(rates), -1, 2).sum(axis=2)
        passed = np.concatenate([np.zeros((len(rates), 1)), np.cumsum(each, axis=1)], axis=1)[:, ::-1]
        at = np.clip(np.append(x0, x), nodes[-1], nodes[0])
        found = [
            _cubic(at, nodes[::-1], one, slope)
            for one, slope in zip(passed, -(ends / speed**2)[:, ::-1], strict=True)
        ]
        since = np.stack([one[1:] - one[0] for one in found], axis=1)
        return -np.maximum(self.rate(x, rates), LEAST)[:, None] * since


def _between(fall: float, speed: float, power: float) -> float:
    """Time in which x falls to where the rate is `speed`, a power of A before."""
    return float(fall / speed if abs(power) < 1e-9 else -np.expm1(-power * fall) / (power * speed))


def _cubic(at: np.ndarray, x: np.ndarray, y: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """Hermite's cubics through values and slopes at rising x."""
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    h = x[i + 1] - x[i]
    u = (at - x[i]) / h
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y[i] + u * h * slope[i]) + u * u * (
        (1.0 + 2.0 * v) * y[i + 1] - v * h * slope[i + 1]
    )
