"""The undamped orbit of a given amplitude, and the frequencies of a restoring law, from its force alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from bayesdamp.physics.rest import by_kernel, frequency_over, rest_near
from bayesdamp.physics.restoring import LAWS

POINTS = 200
REACHES = (1e-3, 0.03, 0.1, 0.25, 0.5)
"""Half widths, in amplitudes, in which a cycle's middle is looked for about its rest."""
_PHASE = (np.arange(POINTS) + 0.5) / POINTS * np.pi - 0.5 * np.pi
_COSINES = np.cos((np.arange(16) + 0.5) / 16 * 2 * np.pi).tolist()
_X, _W = (one.tolist() for one in np.polynomial.legendre.leggauss(48))
_X_PART, _W_PART = (one.tolist() for one in np.polynomial.legendre.leggauss(4))


@dataclass(frozen=True)
class Orbit:
    """Positions x and speeds of an undamped half cycle, with the widths that x is integrated by, each (n,); energy:
    potential energy at its turning points, per unit of inertia."""

    amplitude: float
    energy: float
    x: np.ndarray
    speed: np.ndarray
    width: np.ndarray

    @property
    def frequency(self) -> float:
        """Of the oscillation, rad/s."""
        return float(np.pi / np.sum(self.width / self.speed))


@lru_cache(maxsize=256)
def orbit_at(amplitude: float, restoring: str, law: tuple[float, ...], rest: float) -> Orbit | None:
    """The orbit of an amplitude (rad or m) about `rest`; None where there is none."""
    from scipy.optimize import brentq

    force, values = LAWS.get(restoring).kernel, np.array(law)

    def between(a: float, b: float, nodes: list[float], weights: list[float]) -> float:
        half = 0.5 * (b - a)
        return float(half * sum(w * force(a + half * (u + 1), values) for u, w in zip(nodes, weights)))

    def potential(x: float) -> float:
        return between(rest, x, _X, _W)

    def uneven(shift: float) -> float:
        return potential(rest + shift + amplitude) - potential(rest + shift - amplitude)

    # Narrow brackets first: a wide one reaches beyond the barrier of a softening spring.
    reaches = (share * amplitude for share in REACHES)
    reach = next((r for r in reaches if uneven(-r) < 0 < uneven(r)), None)
    if reach is None:
        return None
    centre = rest + float(brentq(uneven, -reach, reach, xtol=1e-12 * max(amplitude, 1e-300)))  # type: ignore[arg-type]
    energy = potential(centre + amplitude)
    x = centre + amplitude * np.sin(_PHASE)
    # From one point to the next, which a few nodes integrate to rounding error: a twelfth of the forces.
    first, *others = x.tolist()
    parts = [between(a, b, _X_PART, _W_PART) for a, b in zip([first, *others], others)]
    inside = potential(first) + np.concatenate([[0.0], np.cumsum(parts)])
    if inside.max() > energy * (1 + 1e-9):
        return None
    speed = np.sqrt(2 * np.maximum(energy - inside, 0.0))
    width = amplitude * np.cos(_PHASE) * np.pi / POINTS
    return Orbit(amplitude, energy, x, speed, width)


def rest_of(restoring: str, law: np.ndarray, near: float, reach: float) -> float | None:
    """The stable equilibrium nearest to `near` within `reach`; None where there is none."""
    return rest_near(by_kernel(LAWS.get(restoring).kernel, law), near, reach)


def natural_frequency(restoring: str, law: np.ndarray, rest: float, scale: float) -> float:
    """√F′ at the equilibrium, rad/s."""
    d = 1e-5 * scale
    return frequency_over(by_kernel(LAWS.get(restoring).kernel, law), rest - d, rest + d)


def balanced_frequency(restoring: str, law: np.ndarray, rest: float, amplitude: float) -> float:
    """Frequency of the oscillation of an amplitude, rad/s, by the force's first harmonic: a few forces, and near enough
    for how it changes with the law's parameters (N. M. Krylov and N. N. Bogoliubov, 1943)."""
    force = LAWS.get(restoring).kernel
    pull = sum(force(rest + amplitude * c, law) * c for c in _COSINES)
    return float(np.sqrt(max(2 * pull / (len(_COSINES) * amplitude), 0.0)))
