"""A kernel with the numbers that a record fixes: sample times, quantity, scales, knots."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel.build import Kernel, kernel_of, most_parameters
from bayesdamp.physics.kernel.windows import Points, Windows
from bayesdamp.physics.restoring import LAWS

TOLERANCE = 3e-8
"""Error of a step as a share of the amplitude."""
MOST_A_CYCLE = 4000
"""Steps in a cycle after which a motion is given up."""
ROUNDED = 5e-4
"""Share of the peak velocity within which a shape that is steep at rest is rounded off where ε is 0 (conventional)."""
PARTS = 3
"""Of a step, in which trapezoids and low-order formulas take a motion (conventional)."""
QUANTITIES = ("angle", "velocity", "acceleration")
NONE, PARAMETERS, ALL = 0, 1, 2
SHIPPED = (*PAPER_TERMS, "displacement", "stribeck", "power", "cubic", "structural", "dry_position")
"""The damping terms that share one kernel, which is compiled once."""
SHIPPED_LAWS = ("horizontal_pendulum", "linear", "pendulum", "duffing")
"""The restoring laws that share it."""


@dataclass(frozen=True)
class Slopes:
    """Tangents of a motion where its steps end: times (s,), slopes (s, k, 4), of which the columns (p,) are wanted.

    points: where they are read. order: of the derivative that is read there.
    """

    times: np.ndarray
    slopes: np.ndarray
    columns: np.ndarray
    points: Points
    order: int

    def at_samples(self) -> np.ndarray:
        """At each sample, (n, p)."""
        from bayesdamp.physics.kernel.dense import slopes_at_times

        values = slopes_at_times(self.times, self.slopes, self.columns, self.points.t, self.order)
        return self.points.mean(values)

    def pulled(self, weights: np.ndarray) -> np.ndarray:
        """Sum the tangents over the samples by weights, (n,), without those at each sample: (p,)."""
        from bayesdamp.physics.kernel.dense import pulled

        spread = self.points.spread(weights)
        return pulled(self.times, self.slopes, self.columns, self.points.t, self.order, spread)


@dataclass(frozen=True)
class Motion:
    """A trajectory.

    Attributes
    ----------
    y : ndarray, shape (n,)
        Values at the samples.
    slopes : ndarray, shape (n, k), or Slopes
        Their tangents, or the source from which they are read.
    times : ndarray, shape (s,)
        Ends of the steps in s.
    states : ndarray, shape (s, 4)
        θ, θ̇, θ̈ there, and the correction that `dense` needs.
    """

    y: np.ndarray
    slopes: np.ndarray | Slopes
    times: np.ndarray
    states: np.ndarray

    @cached_property
    def tangents(self) -> np.ndarray:
        """Of the values at the samples, (n, k)."""
        return self.slopes.at_samples() if isinstance(self.slopes, Slopes) else self.slopes

    def pulled(self, weights: np.ndarray) -> np.ndarray:
        """Sum the tangents over the samples by weights, (n,): the slope of a function of the values, (k,)."""
        return self.slopes.pulled(weights) if isinstance(self.slopes, Slopes) else weights @ self.slopes

    @cached_property
    def refined(self) -> tuple[np.ndarray, np.ndarray]:
        """Times, (r,), so close that curves between them are short, with θ, θ̇, θ̈ there, (r, 3): steps in `PARTS`.

        Where the acceleration jumps the time is there twice, with the value before and after."""
        from bayesdamp.physics.kernel.dense import at_times

        steps = np.diff(self.times)
        times = self.times[:-1, None] + steps[:, None] * np.arange(PARTS) / PARTS
        values = [at_times(self.times, self.states, times.ravel(), order) for order in range(3)]
        states = np.stack(values, axis=-1).reshape(-1, PARTS, 3)
        states[:, 0] = self.states[:-1, :3]
        ends = (steps[:, None] > 0) | (np.arange(PARTS) == 0)
        return np.append(times[ends], self.times[-1:]), np.vstack([states[ends], self.states[-1:, :3]])


@dataclass(frozen=True)
class _Layout:
    """Places of a solver's parameters among its kernel's.

    own, terms: damping terms of the solver and of its kernel. further: of its kernel's shapes, beside the motion.
    places, (own,), and given: of the solver's terms and their further parameters among them. law: of the law's
    parameters among the solver's. most: parameters that the kernel has room for in a law. number: the law's among the
    kernel's.
    """

    own: int
    terms: int
    further: int
    places: np.ndarray
    given: np.ndarray
    law: slice
    most: int
    number: int


@dataclass(frozen=True)
class Solver:
    """Trajectories of all of `terms` under a law at the times t, (n,) in s; motions start at time 0.

    names: of the parameters, in the order of the vectors that `solve` takes: coefficients, what
    the shapes take further, the law's, θ₀, θ̇₀.
    amplitude (rad or m) and frequency (rad/s) set the scales of tolerances. epsilon (rad/s or m/s): width within which
    friction turns over, 0 for the sign itself, under which a body sticks. windows: of samples, (n,), whose means are
    wanted in place of the values at t; then the last knot must not come before the last sample.
    """

    terms: tuple[str, ...]
    restoring: str
    t: np.ndarray
    quantity: str
    amplitude: float
    frequency: float
    epsilon: float
    knots: np.ndarray
    windows: Windows | None = None

    @property
    def slowness(self) -> float:
        """Cycles of the record for one that is solved."""
        return 1.0

    def at(self, t: np.ndarray, quantity: str) -> Solver:
        """Return the solver at other times t, (n,) in s from 0, within the knots, for another quantity."""
        return replace(self, t=t, quantity=quantity, windows=None)

    @cached_property
    def kernel(self) -> Kernel:
        """Compiled when it is first called."""
        return kernel_of(self._compiled, self._laws)

    @cached_property
    def _compiled(self) -> tuple[str, ...]:
        """The kernel's terms: all that ship share one kernel, as it is compiled once."""
        return SHIPPED if set(self.terms) <= set(SHIPPED) else self.terms

    @cached_property
    def _laws(self) -> tuple[str, ...]:
        """The kernel's restoring laws, likewise."""
        return SHIPPED_LAWS if self.restoring in SHIPPED_LAWS else (self.restoring,)

    @cached_property
    def _places(self) -> np.ndarray:
        """Places of the terms among the kernel's, (m,)."""
        return np.array([self._compiled.index(name) for name in self.terms], int)

    @cached_property
    def further(self) -> tuple[str, ...]:
        """Names of what the shapes take beside the motion, term by term."""
        return tuple(n for name in self.terms for n in TERMS.get(name).further)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of the parameters that `solve` takes, in order."""
        coefficients = tuple(TERMS.get(name).parameter for name in self.terms)
        return (*coefficients, *self.further, *LAWS.get(self.restoring).parameters, "theta0", "omega0")

    @cached_property
    def law_places(self) -> slice:
        """Places of the law's parameters among `names`."""
        first = len(self.terms) + len(self.further)
        return slice(first, first + len(LAWS.get(self.restoring).parameters))

    @cached_property
    def inferred(self) -> tuple[str, ...]:
        """Names of the terms' parameters beside their coefficients."""
        return tuple(p.name for name in self.terms for p in TERMS.get(name).inferred)

    def _points(self, stop: int | None) -> Points:
        """Where motions are read for the first `stop` values, all by default."""
        if stop not in self._read_at:
            self._read_at[stop] = Points.of(self.t[:stop], self.windows and self.windows.first(stop))
        return self._read_at[stop]

    @cached_property
    def _read_at(self) -> dict[int | None, Points]:
        return {}

    @cached_property
    def _layout(self) -> _Layout:
        every = [(name, n) for name in self._compiled for n in TERMS.get(name).further]
        given = [every.index((name, n)) for name in self.terms for n in TERMS.get(name).further]
        return _Layout(
            len(self.terms),
            len(self._compiled),
            len(every),
            self._places,
            np.array(given, int),
            self.law_places,
            most_parameters(self._laws),
            self._laws.index(self.restoring),
        )

    @cached_property
    def _sizes(self) -> np.ndarray:
        a, w = self.amplitude, self.frequency
        usual = {"stiffness": w**2, "gravity": w**2, "cubic": w**2 / a**2}
        return np.array([a, a * w, *(usual.get(n, a) for n in LAWS.get(self.restoring).parameters)])

    def solve(
        self,
        p: np.ndarray,
        active: np.ndarray,
        g: np.ndarray | None = None,
        h: np.ndarray | None = None,
        tangents: int = PARAMETERS,
        stop: int | None = None,
        tolerance: float | None = None,
    ) -> Motion | None:
        """Solve the motion at parameters p, (k,), with deviations g and h at the knots; None where it escapes.

        active: which terms act, (m,). tangents: NONE, by PARAMETERS, or by ALL: parameters, g, h. stop: samples that
        are wanted, the first ones. tolerance: error of a step as a share of the amplitude, `TOLERANCE` by default.
        """
        from bayesdamp.physics.kernel.dense import at_times

        layout = self._layout
        points = self._points(stop)
        t = points.t
        knots, g, h = self._deviations(float(t[-1]), g, h)
        most = int(MOST_A_CYCLE * max(1.0, t[-1] * self.frequency / (2 * np.pi)))
        p = np.asarray(p, float)
        coefficients, switched = np.zeros(layout.terms), np.zeros(layout.terms, bool)
        coefficients[layout.places], switched[layout.places] = p[: layout.own], active
        q = np.zeros(layout.further)
        q[layout.given] = p[layout.own : layout.law.start]
        law, parameters = np.zeros(layout.most + 1), p[layout.law]
        law[: parameters.size], law[-1] = parameters, layout.number
        times, states, slopes = self.kernel.march(
            coefficients, q, switched, law, *self._widths(self.epsilon), p[layout.law.stop :].copy(),
            knots, g, h, tolerance or TOLERANCE, self._sizes, tangents, most,
        )  # fmt: skip
        if times.size == 0:
            return None
        order = QUANTITIES.index(self.quantity)
        y = points.mean(at_times(times, states, t, order))
        if not tangents:
            return Motion(y, np.zeros((y.size, 0)), times, states)
        first = layout.terms + layout.further
        behind = np.arange(first + layout.most, slopes.shape[1])
        columns = np.concatenate(
            [layout.places, layout.terms + layout.given, first + np.arange(parameters.size), behind]
        )
        return Motion(y, Slopes(times, slopes, columns, points, order), times, states)

    def works(
        self,
        x: np.ndarray,
        v: np.ndarray,
        weight: np.ndarray,
        further: np.ndarray,
        active: np.ndarray,
        epsilon: float | None = None,
    ) -> np.ndarray:
        """Weighted sums of the terms' shapes over points (n,), 0 for terms that do not act: (d, m).

        further: rows of the terms' further parameters, (d, e); active: which terms act, (m,); epsilon: in place of the
        solver's own.
        """
        layout = self._layout
        switched, q = np.zeros(layout.terms, bool), np.zeros((len(further), layout.further))
        switched[layout.places], q[:, layout.given] = active, further
        out = np.zeros((len(further), layout.terms))
        points = (np.array(array, float) for array in (x, v, weight))
        widths = self._widths(self.epsilon if epsilon is None else epsilon)
        self.kernel.sums(*points, *widths, q, switched, out)
        return out[:, self._places]

    def _widths(self, epsilon: float) -> tuple[float, float]:
        """ε of terms that jump where it is 0, and of those that are rounded off."""
        return float(epsilon), float(epsilon) or ROUNDED * self.amplitude * self.frequency

    def _deviations(
        self, stop: float, g: np.ndarray | None, h: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        knots = self.knots
        if g is None and h is None and stop < knots[-1]:
            knots = np.array([0.0, stop])
        none = np.zeros(knots.size)
        return knots, none if g is None else np.asarray(g, float), none if h is None else np.asarray(h, float)
