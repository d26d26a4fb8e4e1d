"""What a genetic search varies, and the range that the record itself gives each variable."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.estimators.shared import (
    free_names,
    further_priors,
    known_restoring,
    oscillator,
    start_parameters,
)
from bayesdamp.physics.damping import DampingTerm
from bayesdamp.physics.restoring import RestoringLaw
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Signal

ALONE = 4.0
"""A damping coefficient is searched up to so many times what would make the record's decay alone."""
LEAST_DECAY = 0.05
"""... of at least this much, so that a record that hardly decays has a range too."""
PHASE = 3.0
"""Half-range of the frequency: so many radians of phase over the record, and half a per cent."""
CHANGE = 1e-5
"""Relative step of differences by what Newton's method seeks."""
PHASES, NEWTON = 24, 4
"""Phases of a cycle in a harmonic balance, and Newton steps to its solution."""


class Genes:
    """Unknown parameters as variables u, shape (m, d), with most of the range at 0 ≤ u ≤ 1.

    A damping coefficient is itself, from 0 on. Of a restoring law the variables are what a record shows, the
    frequency and the midline of a motion of its middle amplitude; the law's stiffness and angle follow by
    harmonic balance (a stiffness and a gravity that miss the frequency by a per cent are both far off the
    record's phase, however good each of them is). Its other parameters are themselves, as are theta0 and
    omega0.
    """

    def __init__(self, signal: Signal, problem: Problem, seen: Features) -> None:
        self.osc = oscillator(problem)
        self.known = known_restoring(problem)
        self.base = start_parameters(signal, problem, seen)
        self.further = further_priors(problem, seen)
        self.names = (*self.osc.coefficients, *self.further, *free_names(problem))
        self.size = float(np.sqrt(seen.amplitude * min(seen.final_amplitude, seen.amplitude)))
        self.balanced = [
            name
            for name in self.osc.law.parameters
            if name not in self.known and (name == "stiffness" or name.endswith("angle"))
        ]
        self.low, self.high = np.array([self._range(name, signal, seen) for name in self.names]).T
        meaning = {
            "stiffness": "frequency",
            **{name: "midline" for name in self.balanced if name != "stiffness"},
        }
        self.labels = [meaning.get(name, name) for name in self.names]
        terms = len(self.osc.terms)
        # A motion that decays about as the record does.
        self.middle = np.r_[np.full(terms, 1 / (ALONE * terms)), np.full(len(self.names) - terms, 0.5)]
        self.positive = np.arange(len(self.names)) < terms + len(self.further)

    def _range(self, name: str, signal: Signal, seen: Features) -> tuple[float, float]:
        """From the record: the lowest and highest value searched at first."""
        a, f = seen.amplitude, seen.frequency
        if name in self.osc.coefficients:
            return 0.0, ALONE * alone(self.osc.terms[self.osc.coefficients.index(name)], seen)
        if name in self.further:
            prior = self.further[name]
            ends = (0.0, 2.5) if prior.reflected else (-2.5, 2.5)
            return tuple(float(prior.value(np.asarray(z))) for z in ends)  # type: ignore[return-value]
        if name == "stiffness":
            half = PHASE / (signal.t[-1] - signal.t[0]) + 0.005 * f
            return f - half, f + half
        half = {"theta0": 0.2 * a, "omega0": 0.2 * a * f}.get(name)
        centre = self.base[name]
        if half is None:
            unit = self.osc.law.unit(name)
            half = {"rad": 0.1 * a, "1/(rad² s²)": f**2 / a**2}.get(unit, f**2)
            if name in self.balanced:
                centre = seen.rest
                half = half if signal.quantity == "angle" else a
        return centre - half, centre + half

    def decode(self, u: np.ndarray) -> dict[str, np.ndarray]:
        """Every parameter of the trajectories u (m, d): name to values (m,)."""
        x = dict(zip(self.names, (self.low + u * (self.high - self.low)).T))
        p = {name: np.full(u.shape[0], float(self.base.get(name, 0.0))) for name in self.osc.inputs}
        p |= {name: value for name, value in x.items() if name not in self.balanced}
        if self.balanced:
            law = {name: p[name] for name in self.osc.law.parameters}
            wanted = {name: x[name] for name in self.balanced}
            p |= _balance(self.osc.law, law, wanted, self.size)
        return p


def _balance(
    law: RestoringLaw, p: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray], amplitude: float
) -> dict[str, np.ndarray]:
    """Return the stiffness or angle (m,), or both, of the wanted frequency and midline, by Newton's method.

    p: the law's parameters, each (m,); wanted: the values by the names of what they decide, each (m,). Not finite where
    there is none.
    """
    names = tuple(wanted)
    wave = np.cos(2 * np.pi * (np.arange(PHASES) + 0.5) / PHASES)
    angle = next((name for name in names if name != "stiffness"), None)
    count = next(iter(wanted.values())).size
    rest = np.asarray(wanted[angle] if angle else np.zeros(count))[:, None]

    def missing(x: np.ndarray) -> np.ndarray:
        """By how much (m, k) values x, (m, k), miss what is wanted."""
        at = {n: np.asarray(v)[..., None] for n, v in {**p, **dict(zip(names, x.T, strict=True))}.items()}
        force = law.force(rest + amplitude * wave, at)
        square = 2 * np.mean(force * wave, axis=1) / amplitude
        rows = {"stiffness": square - wanted["stiffness"] ** 2} if "stiffness" in wanted else {}
        return np.stack([rows.get(name, np.mean(force, axis=1)) for name in names], axis=1)

    x = np.stack([np.broadcast_to(p[name], count) for name in names], axis=1).astype(float)
    with np.errstate(all="ignore"):
        for _ in range(NEWTON):
            steps = CHANGE * np.maximum(np.abs(x), 1e-3)
            columns = []
            for i in range(len(names)):
                move = np.zeros_like(x)
                move[:, i] = steps[:, i]
                columns.append((missing(x + move) - missing(x - move)) / (2 * steps[:, i, None]))
            slopes = np.stack(columns, axis=2)
            singular = ~np.isfinite(np.linalg.det(slopes)) | (np.linalg.det(slopes) == 0)
            slopes[singular] = np.nan
            x = x - np.stack([_solved(one, off) for one, off in zip(slopes, missing(x), strict=True)])
    return dict(zip(names, x.T, strict=True))


def _solved(slopes: np.ndarray, off: np.ndarray) -> np.ndarray:
    return np.linalg.solve(slopes, off) if np.all(np.isfinite(slopes)) else np.full(off.size, np.nan)


def alone(term: DampingTerm, seen: Features) -> float:
    """The coefficient with which a term alone would make the decay from the first to the last turning point.

    dA/dt = −c r(A) ω A with r the equivalent damping ratio per unit, so c = ∫dA / (ω A r(A)) over the time.
    """
    sizes = seen.turning_amplitudes
    scale = seen.amplitude / max(float(sizes[0]), 1e-300)
    first, last = float(sizes.max()), float(max(sizes[-1], 2 * seen.roughness, 1e-3 * sizes.max()))
    last = min(last, (1 - LEAST_DECAY) * first)
    grid = np.geomspace(last, first, 65) * scale
    rate = 1.0 / np.array([term.ratio_per_unit(float(a), seen.frequency) for a in grid])
    duration = seen.turning_times[-1] - seen.turning_times[0]
    return float(np.trapezoid(rate, np.log(grid)) / (seen.frequency * duration))
