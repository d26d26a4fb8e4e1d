"""Where the solver's steps lie: chosen from the dynamics, then frozen.

The steps follow the oscillation (a share of the fastest local period) and, where a term switches with the
sign of the velocity within ε, become shorter near the turning points as the distance to the nearest
singularity of tanh(θ̇/ε) does: the number of steps grows with log(1/ε), not 1/ε. Nodes are moved onto the
turning points, where |θ̇|θ̇ has its kink, and where a term asks for the rest position onto the passages through it,
where |θ − θ_e| has one. A mesh belongs to a reference trajectory and is then kept, so that
the likelihood is a smooth function of the parameters and one compiled program serves all of them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from bayesdamp.machine.programs import Program
from bayesdamp.numerics.lazily import jax, jnp
from bayesdamp.physics.oscillator import Oscillator, Parameters, restoring_force

STEPS_PER_PERIOD = 28.0
LAYER = 0.45
"""Step in units of the distance to the singularity of the tanh, at resolution 1."""


def fastest_rate(osc: Oscillator, p: Parameters) -> float:
    """Largest local angular frequency √|F′_rest| (rad/s) over the angles that the motion can reach."""
    theta0, omega0 = float(p["theta0"]), float(p["omega0"])
    try:
        rest = osc.equilibrium(p, theta0)
        base = osc.natural_frequency(p, theta0)
    except ValueError:
        rest, base = 0.0, 0.0
    reach = abs(theta0 - rest) + (abs(omega0) / base if base > 0 else 0.0) + 1e-12
    grid = np.linspace(rest - reach, rest + reach, 65)
    slope = restoring_force(osc.restoring, grid, {n: float(p[n]) for n in osc.law.parameters})[1]
    return max(math.sqrt(float(np.max(np.abs(slope)))), base, 1e-12)


@lru_cache(maxsize=64)
def _marcher(osc: Oscillator, chunk: int):
    """Compiled: `chunk` classical Runge–Kutta steps in the mesh's own variable, dt/ds = local step."""

    def slope(state, p, longest, layer):
        _, theta, omega = state
        a = osc.acceleration(theta, omega, p)
        inverse = 1.0 / longest
        if osc.switches:
            inverse = inverse + jnp.abs(a) / (layer * jnp.sqrt(omega**2 + (0.5 * jnp.pi * p["epsilon"]) ** 2))
        local = 1.0 / inverse
        return local, local * omega, local * a

    def march(state, p, longest, layer):
        def one(state, _):
            def shifted(factor, k):
                return tuple(x + factor * d for x, d in zip(state, k))

            k1 = slope(state, p, longest, layer)
            k2 = slope(shifted(0.5, k1), p, longest, layer)
            k3 = slope(shifted(0.5, k2), p, longest, layer)
            k4 = slope(shifted(1.0, k3), p, longest, layer)
            new = tuple(x + (a + 2 * b + 2 * c + d) / 6 for x, a, b, c, d in zip(state, k1, k2, k3, k4))
            return new, new

        return jax.lax.scan(one, state, None, length=chunk)

    return Program(march, "march", osc, chunk)


def frozen_mesh(osc: Oscillator, p: Parameters, duration: float, resolution: float = 1.0) -> np.ndarray:
    """Times of the nodes from 0 to `duration`, shape (m + 1,), for ε > 0.

    resolution: steps are shorter by this factor than the standard ones.
    """
    p = {name: np.float64(value) for name, value in p.items()}
    chunk = 256
    march = _marcher(osc, chunk)
    longest = 2 * math.pi / fastest_rate(osc, p) / STEPS_PER_PERIOD / resolution
    state = (np.float64(0.0), p["theta0"], p["omega0"])
    times, velocities = [np.zeros(1)], [np.asarray(p["omega0"])[None]]
    rest = float(osc.settled(p)["rest"]) if "rest" in osc.scales else None  # type: ignore[arg-type]
    angles = [np.asarray(p["theta0"])[None]]
    limit = 4_000_000
    while times[-1][-1] < duration:
        state, (t, theta, omega) = march(state, p, longest, LAYER / resolution)
        t, theta, omega = np.asarray(t), np.asarray(theta), np.asarray(omega)
        stuck = not np.all(np.isfinite(t)) or t[-1] <= times[-1][-1]
        if stuck or sum(map(len, times)) > limit:  # escaped: a plain mesh, the trajectory is refused later
            return np.linspace(0.0, duration, max(16, math.ceil(duration / longest)) + 1)
        times.append(t)
        velocities.append(omega)
        angles.append(theta)
    zeros = [np.concatenate(velocities)] + ([] if rest is None else [np.concatenate(angles) - rest])
    return _regular(np.concatenate(times), zeros, duration)


def _regular(t: np.ndarray, zeros: list[np.ndarray], duration: float) -> np.ndarray:
    """The same grading with a whole number of steps up to `duration`, nodes where one of `zeros`, each (n,), is 0."""
    last = int(np.searchsorted(t, duration))
    count = last - 1 + (duration - t[last - 1]) / (t[last] - t[last - 1])
    steps = max(16, math.ceil(count))
    nodes = np.interp(np.linspace(0.0, count, steps + 1), np.arange(t.size), t)
    nodes[-1] = duration
    for values in zeros:
        i = np.flatnonzero(values[:-1] * values[1:] < 0)
        kinks = t[i] - values[i] * (t[i + 1] - t[i]) / (values[i + 1] - values[i])
        kinks = kinks[kinks < duration]
        nearest = np.clip(np.searchsorted(nodes, kinks), 1, steps - 1)
        nearest -= (kinks - nodes[nearest - 1] < nodes[nearest] - kinks) & (nearest > 1)
        nodes[nearest] = kinks
    return nodes if np.all(np.diff(nodes) > 0) else np.sort(nodes)
