"""Simulated records in which a hand holds, strikes or drives the oscillator; the free part is known."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from tests.physics.independent import with_coulomb

W = 2 * np.pi
"""Angular frequency in rad/s: a period is a second."""
Force = Callable[[float, float, float], float]


@dataclass(frozen=True)
class Rig:
    """An oscillator of period 1 s; its dry friction is smoothed over half a per cent of W."""

    zeta: float = 0.0
    mu_c: float = 0.0
    mu_q: float = 0.0

    def run(self, t: np.ndarray, start: float, speed=0.0, force: Force = lambda t, x, v: 0.0) -> np.ndarray:
        """Return displacement, velocity and acceleration at times t (n,) under a force, by SciPy, (3, n)."""

        def slope(time: float, u: np.ndarray) -> list[float]:
            x, v = u
            damping = 2 * self.zeta * v + self.mu_c * np.tanh(v / (0.005 * W)) + self.mu_q * v * abs(v)
            return [v, -W * W * x - damping + force(time, x, v)]

        end = (t[0], t[-1] + 1e-9)
        run = solve_ivp(slope, end, [start, speed], "LSODA", t, rtol=1e-7, atol=1e-9, max_step=0.04)
        accelerations = [slope(float(a), u)[1] for a, u in zip(run.t, run.y.T, strict=True)]
        return np.array([*run.y, accelerations])


@dataclass(frozen=True)
class Record:
    """Times t and values y (n,), and start and stop of the free decay in s."""

    t: np.ndarray
    y: np.ndarray
    start: float
    stop: float


def rig(rng: np.random.Generator, cycles: float) -> Rig:
    """Return a random damping under which an amplitude of 1 falls to about a tenth within the given cycles."""
    viscous, friction = rng.uniform(2, 3) / cycles, W * W / (4.6 * cycles)
    drag = 3 * rng.uniform(3, 8) / (8 * cycles)
    laws = [(viscous,), (0, friction), (0, 0, drag), (viscous / 2, friction / 3), (viscous / 2, 0, drag / 2)]
    return Rig(*laws[int(rng.integers(len(laws)))])


def held_then_released(rng: np.random.Generator, hold: float, tilt: float, per_cycle: float) -> Record:
    """Return a body that a hand tilts slowly for `tilt` s, holds for `hold` s, and releases from 1."""
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
    """Return a body that a half sine of force strikes. row: 0 displacement, 1 velocity, 2 acceleration."""
    cycles, rest, long = rng.uniform(6, 20), rng.uniform(0.5, 5), rng.uniform(0.05, 0.3)
    t = np.arange(0, rest + cycles, 1 / rng.uniform(25, 100))

    def force(time: float, x: float, v: float) -> float:
        push = W * np.pi / 2 / long * np.sin(np.pi * (time - rest) / long)
        return push if rest <= time <= rest + long else 0.0

    y = rig(rng, cycles).run(t, 0.0, force=force)[row]
    return Record(t, y / W**row, rest + long, float(t[-1]))


def driven(rng: np.random.Generator) -> Record:
    """Return a body that a force in phase with its velocity drives at an amplitude of 1 for some cycles."""
    cycles, long = rng.uniform(8, 20), rng.uniform(6, 14)
    chosen = Rig(rng.uniform(2, 3) / cycles)
    t = np.arange(0, long + cycles, 1 / rng.uniform(25, 100))

    def force(time: float, x: float, v: float) -> float:
        return 2 * chosen.zeta * v if time < long else 0.0

    return Record(t, chosen.run(t, 1.0, force=force)[0], long, float(t[-1]))


def released_twice(rng: np.random.Generator) -> Record:
    """Return a decay that a hand stops early, tilts again and releases for a complete decay."""
    cycles, hold = rng.uniform(8, 20), rng.uniform(1, 4)
    chosen, early = rig(rng, cycles), rng.uniform(0.3, 0.5) * cycles
    t = np.arange(0, early + hold + cycles, 1 / rng.uniform(25, 100))
    first, second = t[t < early], t[t >= early + hold]
    begin = chosen.run(first, 0.8)[0]
    part = np.clip((t[first.size : -second.size] - early) / (0.8 * hold), 0, 1)
    tilt = begin[-1] + (1 - begin[-1]) * (0.5 - 0.5 * np.cos(np.pi * part))
    decay = chosen.run(np.concatenate([[early + hold - 1e-9], second]), 1.0)[0][1:]
    return Record(t, np.concatenate([begin, tilt, decay]), early + hold, float(t[-1]))


def sticking(rng: np.random.Generator) -> Record:
    """Return dry friction in closed form, from 1 until the body sticks within ±friction."""
    friction, per_cycle = rng.uniform(0.02, 0.06), rng.uniform(25, 100)
    t = np.arange(0, 0.25 / friction + rng.uniform(1, 6), 1 / per_cycle)
    p = {"stiffness": W * W, "rest_angle": 0.0, "mu_c": friction * W * W, "theta0": 1.0, "omega0": 0.0}
    y = with_coulomb(p, t)[:, 0]
    return Record(t, y, 0.0, float(t[np.argmax(y == y[-1]) - 1]))
