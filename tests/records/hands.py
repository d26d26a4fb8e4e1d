"""Records that a hand had a part in, by SciPy's own integrator: what is not free in them is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

W = 2 * np.pi
"""Angular frequency in rad/s: a period is a second."""
Force = Callable[[float, float, float], float]


@dataclass(frozen=True)
class Rig:
    """An oscillator of period 1 s with these coefficients; dry friction is exact but for ε, half a per cent of W."""

    zeta: float = 0.0
    mu_c: float = 0.0
    mu_q: float = 0.0

    def run(
        self, t: np.ndarray, at: float, speed: float = 0.0, force: Force = lambda t, x, v: 0.0
    ) -> np.ndarray:
        """(displacement, velocity, acceleration), each (n,), at times t (n,), with a hand's force."""

        def pushed(time: float, u: np.ndarray) -> list[float]:
            x, v = u
            damping = 2 * self.zeta * v + self.mu_c * np.tanh(v / (0.005 * W)) + self.mu_q * v * abs(v)
            return [v, -W * W * x - damping + force(time, x, v)]

        end = (t[0], t[-1] + 1e-9)
        run = solve_ivp(pushed, end, [at, speed], "LSODA", t, rtol=1e-7, atol=1e-9, max_step=0.04)
        rates = [pushed(float(a), u)[1] for a, u in zip(run.t, run.y.T, strict=True)]
        return np.array([run.y[0], run.y[1], rates])


@dataclass(frozen=True)
class Record:
    """Times t and values y (n,); start (s) from which it is free; stop (s) up to which it may be taken."""

    t: np.ndarray
    y: np.ndarray
    start: float
    stop: float


def rig(rng: np.random.Generator, cycles: float) -> Rig:
    """Damping of a law drawn by lot, by which an amplitude of 1 falls to a tenth or so within so many cycles."""
    viscous, friction, drag = (
        rng.uniform(2, 3) / cycles,
        W * W / (4.6 * cycles),
        3 * rng.uniform(3, 8) / (8 * cycles),
    )
    laws = (
        Rig(viscous),
        Rig(mu_c=friction),
        Rig(mu_q=drag),
        Rig(viscous / 2, friction / 3),
        Rig(viscous / 2, 0, drag / 2),
    )
    return laws[int(rng.integers(len(laws)))]


def held_then_released(rng: np.random.Generator, hold: float, tilt: float, per_cycle: float) -> Record:
    """Tilted slowly for `tilt` s, held for `hold` s, released from 1; all that time the hand's path is its own."""
    cycles = rng.uniform(6, 20)
    t = np.arange(0, tilt + hold + cycles, 1 / per_cycle)
    free = t >= tilt + hold
    path = np.ones(t.size)
    if tilt:
        part = np.clip(t / tilt, 0, 1)
        path = (part, 0.5 - 0.5 * np.cos(np.pi * part), part**2)[int(rng.integers(3))]
    path[free] = rig(rng, cycles).run(np.concatenate([[tilt + hold - 1e-9], t[free]]), 1.0)[0][1:]
    return Record(t, path, tilt + hold, float(t[-1]))


def kicked(rng: np.random.Generator, row: int = 0) -> Record:
    """At rest, then a half sine of force, then free. row: 0 displacement, 1 velocity, 2 acceleration."""
    cycles, rest, long = rng.uniform(6, 20), rng.uniform(0.5, 5), rng.uniform(0.05, 0.3)
    t = np.arange(0, rest + cycles, 1 / rng.uniform(25, 100))

    def force(time: float, x: float, v: float) -> float:
        return (
            W * np.pi / 2 / long * np.sin(np.pi * (time - rest) / long)
            if rest <= time <= rest + long
            else 0.0
        )

    y = rig(rng, cycles).run(t, 0.0, force=force)[row]
    return Record(t, y / W**row, rest + long, float(t[-1]))


def driven(rng: np.random.Generator) -> Record:
    """Driven at an amplitude of 1 for some cycles, by a force in phase with the velocity, then free."""
    cycles, long = rng.uniform(8, 20), rng.uniform(6, 14)
    chosen = Rig(rng.uniform(2, 3) / cycles)
    t = np.arange(0, long + cycles, 1 / rng.uniform(25, 100))

    def force(time: float, x: float, v: float) -> float:
        return 2 * chosen.zeta * v if time < long else 0.0

    return Record(t, chosen.run(t, 1.0, force=force)[0], long, float(t[-1]))


def released_twice(rng: np.random.Generator) -> Record:
    """A decay that a hand ends before its half and tilts again, and one that runs out."""
    cycles, hold = rng.uniform(8, 20), rng.uniform(1, 4)
    chosen, early = rig(rng, cycles), rng.uniform(0.3, 0.5) * cycles
    t = np.arange(0, early + hold + cycles, 1 / rng.uniform(25, 100))
    first, second = t < early, t >= early + hold
    y = np.empty(t.size)
    y[first] = chosen.run(t[first], 0.8)[0]
    last = y[first][-1]
    part = np.clip((t[~first & ~second] - early) / (0.8 * hold), 0, 1)
    y[~first & ~second] = last + (1 - last) * (0.5 - 0.5 * np.cos(np.pi * part))
    y[second] = chosen.run(np.concatenate([[early + hold - 1e-9], t[second]]), 1.0)[0][1:]
    return Record(t, y, early + hold, float(t[-1]))


def sticking(rng: np.random.Generator) -> Record:
    """Dry friction by its closed form: half sines of period 1 s about ±friction, until one ends within it."""
    friction, per_cycle = rng.uniform(0.02, 0.06), rng.uniform(25, 100)
    t = np.arange(0, 0.25 / friction + rng.uniform(1, 6), 1 / per_cycle)
    y, at, begin = np.empty(t.size), 1.0, 0.0
    while abs(at) > friction:
        centre = friction * np.sign(at)
        inside = t >= begin
        y[inside] = centre + (at - centre) * np.cos(W * (t[inside] - begin))
        at, begin = 2 * centre - at, begin + 0.5
    y[t >= begin] = at
    return Record(t, y, 0.0, begin)
