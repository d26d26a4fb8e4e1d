"""A record as networks use it: few enough samples, its own scales, and the phase of its oscillation."""

from __future__ import annotations

import numpy as np
import torch
from numpy.polynomial import Polynomial

from bayesdamp.estimators.networks.training import REAL
from bayesdamp.estimators.shared import (
    ORDER,
    epsilon_of,
    noise_level,
    oscillator,
    ratios_per_unit,
    start_parameters,
)
from bayesdamp.physics.forces import slope_of
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Signal

WITHIN = 1e-2
"""Step of differences by the velocity, as a share of the width of a switch."""
MOST_SAMPLES = 1500
PER_CYCLE = 40.0
"""Means are taken over no more than this part of a cycle: the mean of a sinusoid is then 0.1 % small."""


def thin_record(signal: Signal, features: Features, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return (t, y) with about `most` samples or fewer: means of neighbours if there is noise, else a selection."""
    t, y = signal.t, signal.y
    size = float(np.abs(features.turning_amplitudes).max())
    if t.size > most and noise_level(signal) > 1e-5 * size:
        group = min(-(-t.size // most), max(1, int(features.samples_per_cycle / PER_CYCLE)))
        blocks = t.size // group
        times = t[: blocks * group].reshape(blocks, group)
        whole = times[:, -1] - times[:, 0] <= 1.5 * (group - 1) * float(np.median(np.diff(t)))
        t, y = times.mean(axis=1)[whole], y[: blocks * group].reshape(blocks, group).mean(axis=1)[whole]
    rows = np.unique(np.linspace(0, t.size - 1, min(most, t.size)).round().astype(int))
    return t[rows], y[rows]


class ScaledRecord:
    """A record and its oscillator in the record's scales: the amplitude a and the angular frequency w.

    t, recorded: samples, (n,) each. y: the samples about the rest, in amplitudes. base: all parameters but damping.
    ratios: equivalent damping ratio per unit of each coefficient.
    coefficients, restoring: names of the unknowns. given, begin: which of angle and velocity at the start are known,
    and their values in amplitudes.
    """

    def __init__(self, signal: Signal, problem: Problem, features: Features) -> None:
        osc, known = oscillator(problem), problem.system.known
        self.base = start_parameters(signal, problem, features)
        self.a, self.w, self.order = features.amplitude, features.frequency, ORDER[signal.quantity]
        self.rest = features.rest if self.order == 0 else osc.equilibrium(self.base)
        self.ratios = ratios_per_unit(problem, features)
        self.coefficients = osc.coefficients
        self.restoring = tuple(name for name in osc.law.parameters if name not in known)
        self._osc, self._epsilon = osc, epsilon_of(problem, features)
        self.t, self.recorded = thin_record(signal, features, MOST_SAMPLES)
        middle = self.rest if self.order == 0 else 0.0
        self.y = torch.from_numpy((self.recorded - middle) / (self.a * self.w**self.order))
        wanted = [(known.get("theta0"), self.rest, self.a), (known.get("omega0"), 0.0, self.a * self.w)]
        self.given = [i for i, (value, _, _) in enumerate(wanted) if value is not None]
        scaled = [(v - zero) / unit for v, zero, unit in wanted if v is not None]
        self.begin = torch.tensor(scaled, dtype=REAL)

    def restoring_force(
        self, theta: np.ndarray, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return F_rest, rad/s², at angles (n,), its slope by θ (n,), and its derivatives by `restoring` (n, k).

        values (k,): of the unknown restoring parameters.
        """
        law = self._osc.law
        p = {name: self.base[name] for name in law.parameters} | dict(zip(self.restoring, values.tolist()))
        by = [
            slope_of(lambda v, name=name: law.force(theta, {**p, name: v}), np.full(theta.size, p[name]))
            for name in self.restoring
        ]
        return law.force(theta, p), law.slope(theta, p), np.array(by).reshape(-1, theta.size).T

    def damping_shapes(self, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the damping force per unit of each coefficient and its slope by θ̇, both (n, terms)."""
        still = np.zeros_like(omega)
        step = WITHIN * self._epsilon if self._osc.switches and self._epsilon > 0 else None
        values, slopes = [], []
        for term in self._osc.terms:
            values.append(term.force(still, omega, self._epsilon))
            slopes.append(slope_of(lambda v, t=term: t.force(still, v, self._epsilon), omega, step))
        return np.column_stack(values), np.column_stack(slopes)


def phase_of(signal: Signal, features: Features) -> Polynomial:
    """Return the phase of a record in rad, which grows by π from each crossing of the midline to the next.

    It is a polynomial in time: of degree 3 if the crossings span most of the record, so that it follows a frequency
    that drifts with the amplitude, else a straight line.
    """
    crossings, count = features.crossing_times, features.crossing_times.size
    span = (crossings[-1] - crossings[0]) / (signal.t[-1] - signal.t[0]) if count else 0.0
    if count >= 8 and span > 0.75:
        weight = np.abs(features.turning_amplitudes[1:] * features.turning_amplitudes[:-1]) ** 0.5
        return Polynomial.fit(crossings, np.pi * np.arange(count), 3, w=weight)
    return Polynomial([-features.frequency * features.turning_times[0], features.frequency])
