"""The damping force that a record shows, with the restoring force taken off."""

from __future__ import annotations

import numpy as np

from bayesdamp.estimators.evolution.expressions import Expression
from bayesdamp.estimators.shared import ORDER, known_restoring, motion, noise_level, oscillator, solved
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Signal

KNOTS = (5.0, 6.0, 8.0, 11.0, 16.0, 23.0, 32.0)
"""Knots a period to choose from: more show the shape of the force, and more of the noise."""
AFFORDABLE = 0.1
"""Noise of the acceleration that more knots may bring, as a share of the damping force."""
HATS = 25
"""Hat functions of the velocity, at most, that stand for an unknown damping force."""


class Force:
    """−(θ̈ + F_rest(θ)) over a record, and how well an expression of θ̇ tells it.

    omega: velocities at all samples that are used, (n,), rad/s. independent: samples that count as
    independent. theta0, omega0: displacement and velocity at the record's start.
    Restoring parameters that are not known (and constants of integration that were guessed) are regressed
    out: together with an expression, or at first with hat functions of θ̇ that vanish at rest.
    """

    def __init__(self, signal: Signal, problem: Problem, seen: Features) -> None:
        knots = _knots_per_period(signal, seen)
        self.motion = motion(signal, problem, seen, knots)
        theta, self.omega, _ = self.motion.everywhere
        self.theta0, self.omega0 = self.motion.theta0, self.motion.omega0
        known = known_restoring(problem)
        form = oscillator(problem).law.linear_form(theta, known)
        self.target = -(self.motion.alpha + self.motion.project(form.offset))
        drift = self.motion.integrated if len(known) else 0
        columns = [self.motion.project(column) for column in form.columns.T]
        columns += [(self.motion.t - self.motion.t[0]) ** j for j in range(drift)]
        self._count, self._decode = form.columns.shape[1], form.decode
        self._columns = np.column_stack(columns) if columns else np.zeros((self.motion.t.size, 0))
        columns_of_unit_length = self._columns / np.maximum(np.linalg.norm(self._columns, axis=0), 1e-300)
        self._basis = np.linalg.svd(columns_of_unit_length, full_matrices=False)[0]
        duration = float(self.motion.t[-1] - self.motion.t[0])
        self.independent = (
            self.motion.t.size if self.motion.clean else max(self.motion.bandwidth * duration / np.pi, 4.0)
        )
        shown = self.target - self._columns @ self._first()
        self._variance = float(np.var(shown))
        self._shown = shown

    def _first(self) -> np.ndarray:
        """Coefficients of the restoring force beside an arbitrary function of θ̇."""
        count = self._columns.shape[1]
        if count == 0:
            return np.zeros(0)
        hats = int(np.clip(self.independent // 6, 4, HATS))
        fastest = float(np.abs(self.omega).max())
        at = fastest * np.linspace(-1, 1, hats + 1 - hats % 2)  # an odd number: one at rest
        eye = np.eye(at.size)
        free = [self.motion.project(np.interp(self.omega, at, row)) for row in eye if row[at.size // 2] == 0]
        return solved(np.column_stack([self._columns, *free]), self.target, 1e-10)[:count]

    def thinned(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and forces at evenly spread samples, each (m,), and as many mirrored: a force that
        resists motion is odd, and nothing else is to be learnt from noise."""
        count = min(samples // 2, self._shown.size)
        rows = np.linspace(0, self._shown.size - 1, count).round().astype(int)
        x, y = self.motion.omega[rows], self._shown[rows]
        return np.r_[x, -x], np.r_[y, -y]

    def _left(self, expression: Expression) -> np.ndarray:
        left = self.target - self.motion.project(expression(self.omega))
        return left - self._basis @ (self._basis.T @ left)

    def misfit(self, expression: Expression) -> np.ndarray:
        """What an expression leaves, (m,), in units of the force's standard deviation."""
        return self._left(expression) / np.sqrt(self._variance)

    def error(self, expression: Expression) -> float:
        """Mean square of `misfit`."""
        return float(np.mean(self.misfit(expression) ** 2))

    def restoring(self, expression: Expression) -> dict[str, float]:
        """Restoring parameters that are not known, beside the expression."""
        if self._count == 0:
            return {}
        left = self.target - self.motion.project(expression(self.omega))
        return self._decode(solved(self._columns, left)[: self._count])


def _knots_per_period(signal: Signal, seen: Features) -> float:
    """As many as the noise allows, so that the shape of the force is seen.

    A spline that follows angular frequencies up to b passes noise of a sampling interval Δt and a standard
    deviation σ into the second derivative as σ √(Δt b⁵/5π), into the first as σ √(Δt b³/3π).
    """
    noise, gap = noise_level(signal), float(signal.t[-1] - signal.t[0]) / (signal.t.size - 1)
    order = 2 - ORDER[signal.quantity]
    sizes = seen.turning_amplitudes
    lost = np.log(max(float(sizes.max()) / max(float(sizes[-1]), 2 * seen.roughness, 1e-12), 1.05))
    ratio = lost / (seen.frequency * (seen.turning_times[-1] - seen.turning_times[0]))
    middle = seen.frequency**2 * np.sqrt(seen.amplitude * min(seen.final_amplitude, seen.amplitude))
    force = np.sqrt(2.0) * ratio * middle
    best = KNOTS[0]
    for knots in KNOTS[1:]:
        band = np.pi * knots / seen.period
        passed = noise * np.sqrt(gap * band ** (2 * order + 1) / ((2 * order + 1) * np.pi))
        if passed <= AFFORDABLE * force and seen.period / knots >= 6 * gap:
            best = knots
    return best
