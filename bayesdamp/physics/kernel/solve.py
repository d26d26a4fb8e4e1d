"""Solve motions at the times of a record, with a compiled kernel, and read their tangents there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel.build import Kernel, kernel_of, most_parameters
from bayesdamp.physics.restoring import LAWS

TOLERANCE = 3e-8
"""Error of a step as a share of the amplitude."""
MOST_A_CYCLE = 4000
"""Most steps in a cycle; a motion that needs more is taken for one that escapes."""
ROUNDED = 5e-4
"""Share of the peak velocity within which a shape that is steep at rest is rounded off where ε is 0 (conventional)."""
PARTS = 3
"""Parts of a step, short enough for trapezoids and formulas of low order (conventional)."""
QUANTITIES = ("angle", "velocity", "acceleration")
NONE, PARAMETERS, ALL = 0, 1, 2
SHIPPED = (*PAPER_TERMS, "displacement", "stribeck", "power", "cubic", "structural", "dry_position")
"""The damping terms that share one kernel, which is compiled once."""
SHIPPED_LAWS = ("horizontal_pendulum", "linear", "pendulum", "duffing")
"""The restoring laws that share it."""


@dataclass(frozen=True)
class Windows:
    """Two points and weights in each window of samples.

    The weighted sum of a motion's values at the two points is its mean over the samples: exactly for a cubic
    polynomial (the Gauss rule of two points for the samples' own times), and within 1e-8 of the amplitude for an
    oscillation with windows of an eightieth of a cycle.

    Attributes
    ----------
    times : ndarray, shape (n, 2)
        The points, rising, in s.
    weights : ndarray, shape (n, 2)
        Their weights, of sum 1 in each window.

    References
    ----------
    G. H. Golub and J. H. Welsch, Calculation of Gauss quadrature rules, Math. Comp. 23, 221 (1969).
    """

    times: np.ndarray
    weights: np.ndarray

    @classmethod
    def of(cls, t: np.ndarray) -> Self:
        """Return the points and weights of windows from the times of their samples.

        Parameters
        ----------
        t : ndarray, shape (n, m)
            The times of the m samples in each of n windows, in s.
        """
        middle = t.mean(axis=1)
        off = t - middle[:, None]
        sd = np.sqrt(np.mean(off**2, axis=1))
        scale = np.where(sd > 0, sd, 1.0)
        skewness = np.mean((off / scale[:, None]) ** 3, axis=1)
        root = np.sqrt(skewness**2 + 4)
        low, high = 0.5 * (skewness - root), 0.5 * (skewness + root)
        times = middle[:, None] + sd[:, None] * np.column_stack([low, high])
        return cls(times, np.column_stack([high, -low]) / root[:, None])

    def first(self, count: int) -> Windows:
        """Return the first windows."""
        return Windows(self.times[:count], self.weights[:count])


@dataclass(frozen=True)
class Points:
    """Times at which a motion is read, and how its values there become those that are wanted.

    Attributes
    ----------
    t : ndarray, shape (n,) or, with weights, (2n,)
        Rising, in s.
    weights : ndarray, shape (n, 2), or None
        The weights of neighbouring points; None where the values at the points are wanted themselves.
    """

    t: np.ndarray
    weights: np.ndarray | None = None

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the wanted values, shape (n, ...), from those at the points."""
        if self.weights is None:
            return values
        first, second = self.weights.T.reshape(2, -1, *(1,) * (values.ndim - 1))
        return first * values[::2] + second * values[1::2]


@dataclass(frozen=True)
class Slopes:
    """Tangents of a motion at the ends of its steps, from which those at the samples are computed.

    times: ends of the steps in s, (s,). slopes: tangents by all parameters of the kernel, (s, k, 4). columns: places
    of the solver's parameters among these, (p,). points: times at which the motion is read. order: of the derivative
    that is read.
    """

    times: np.ndarray
    slopes: np.ndarray
    columns: np.ndarray
    points: Points
    order: int

    def at_samples(self) -> np.ndarray:
        """Return the tangents at each sample, (n, p)."""
        from bayesdamp.physics.kernel.dense import slopes_at_times

        values = slopes_at_times(self.times, self.slopes, self.columns, self.points.t, self.order)
        return self.points.mean(values)


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
        """Return the tangents of the values at the samples, (n, k)."""
        return self.slopes.at_samples() if isinstance(self.slopes, Slopes) else self.slopes

    def without_tangents(self) -> Motion:
        """Return the motion alone."""
        return Motion(self.y, np.zeros((self.y.size, 0)), self.times, self.states)

    @cached_property
    def refined(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times, (r,), that divide each step into `PARTS`, and θ, θ̇, θ̈ at these, (r, 3).

        A time at which the acceleration jumps occurs twice, with the values before and after.
        """
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

    terms: of the solver's damping terms, (m,). given: of their further parameters, (e,), among `further` of them. law:
    number of the restoring law. most: parameters that the kernel has room for in a law.
    """

    terms: np.ndarray
    given: np.ndarray
    further: int
    law: int
    most: int


@dataclass(frozen=True)
class Solver:
    """Solve the motions of an oscillator at fixed times; they start at time 0.

    Attributes
    ----------
    terms, restoring
        The damping terms, any of which may be off in a motion, and the restoring law.
    t
        Times of the samples in s, (n,).
    quantity
        One of `QUANTITIES`.
    amplitude, frequency
        Scales of the tolerances, in rad or m and in rad/s.
    epsilon
        Width of the velocity, rad/s or m/s, within which friction changes its sign; with 0 it is the sign itself, and
        the body may stick.
    knots
        Times in s between which deviations are linear, (k,).
    windows
        Windows of samples, (n,), whose means replace the values at t; then the last knot must not come before the last
        sample.
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
        """Return the number of the record's cycles for each cycle that is solved."""
        return 1.0

    def at(self, t: np.ndarray, quantity: str) -> Solver:
        """Return the solver at other times t, (n,) in s from 0, within the knots, for another quantity."""
        return replace(self, t=t, quantity=quantity, windows=None)

    @cached_property
    def kernel(self) -> Kernel:
        """Return the kernel, which is compiled at its first call; one kernel serves all terms and laws that ship."""
        terms = SHIPPED if set(self.terms) <= set(SHIPPED) else self.terms
        return kernel_of(terms, SHIPPED_LAWS if self.restoring in SHIPPED_LAWS else (self.restoring,))

    @cached_property
    def further(self) -> tuple[str, ...]:
        """Return the names of the terms' arguments besides the motion, term by term."""
        return tuple(n for name in self.terms for n in TERMS.get(name).further)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters of `solve`: coefficients, `further`, the law's, theta0, omega0."""
        coefficients = tuple(TERMS.get(name).parameter for name in self.terms)
        return (*coefficients, *self.further, *LAWS.get(self.restoring).parameters, "theta0", "omega0")

    @cached_property
    def law_places(self) -> slice:
        """Return the places of the law's parameters among `names`."""
        first = len(self.terms) + len(self.further)
        return slice(first, first + len(LAWS.get(self.restoring).parameters))

    @cached_property
    def inferred(self) -> tuple[str, ...]:
        """Return the names of the terms' parameters besides their coefficients."""
        return tuple(p.name for name in self.terms for p in TERMS.get(name).inferred)

    @cached_property
    def _read_at(self) -> dict[int | None, Points]:
        return {}

    @cached_property
    def _layout(self) -> _Layout:
        terms, laws = self.kernel.terms, self.kernel.laws
        every = [(name, n) for name in terms for n in TERMS.get(name).further]
        given = [every.index((name, n)) for name in self.terms for n in TERMS.get(name).further]
        places = np.array([terms.index(name) for name in self.terms], int)
        most = most_parameters(laws)
        return _Layout(places, np.array(given, int), len(every), laws.index(self.restoring), most)

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
        """Solve a motion; return None where it escapes.

        Parameters
        ----------
        p
            Parameters in the order of `names`, (k,).
        active
            Which terms act, (m,).
        g, h
            Relative deviations of the damping and of the frequency at the knots; none by default.
        tangents
            `NONE`, by `PARAMETERS`, or by `ALL`: the parameters, g and h.
        stop
            Number of samples, from the first on; all by default.
        tolerance
            Error of a step as a share of the amplitude; `TOLERANCE` by default.
        """
        from bayesdamp.physics.kernel.dense import at_times

        layout, m, law_places = self._layout, len(self.kernel.terms), self.law_places
        if stop not in self._read_at:
            # Writable copies: Numba would compile again for an array that is read-only.
            self._read_at[stop] = (
                Points(np.array(self.t[:stop], float))
                if self.windows is None
                else Points(self.windows.times[:stop].flatten(), self.windows.weights[:stop])
            )
        points = self._read_at[stop]
        t, knots = points.t, self.knots
        if g is None and h is None and t[-1] < knots[-1]:
            knots = np.array([0.0, float(t[-1])])
        g, h = (np.zeros(knots.size) if d is None else np.asarray(d, float) for d in (g, h))
        most = int(MOST_A_CYCLE * max(1.0, t[-1] * self.frequency / (2 * np.pi)))
        p = np.asarray(p, float)
        coefficients, switched = np.zeros(m), np.zeros(m, bool)
        coefficients[layout.terms], switched[layout.terms] = p[: len(self.terms)], active
        q = np.zeros(layout.further)
        q[layout.given] = p[len(self.terms) : law_places.start]
        law, parameters = np.zeros(layout.most + 1), p[law_places]
        law[: parameters.size], law[-1] = parameters, layout.law
        times, states, slopes = self.kernel.march(
            coefficients, q, switched, law, *self._widths(self.epsilon), p[law_places.stop :].copy(),
            knots, g, h, tolerance or TOLERANCE, self._sizes, tangents, most,
        )  # fmt: skip
        if times.size == 0:
            return None
        order = QUANTITIES.index(self.quantity)
        y = points.mean(at_times(times, states, t, order))
        if not tangents:
            return Motion(y, np.zeros((y.size, 0)), times, states)
        first = m + layout.further
        columns = [layout.terms, m + layout.given, first + np.arange(parameters.size)]
        columns = np.concatenate([*columns, np.arange(first + layout.most, slopes.shape[1])])
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
        """Return weighted sums of the terms' forces per unit of their coefficients, (d, m); 0 for terms that are off.

        Parameters
        ----------
        x, v, weight
            Displacement, velocity and weight of each point, (n,).
        further
            Rows of the terms' further parameters, (d, e).
        active
            Which terms act, (m,).
        epsilon
            In place of the solver's own.
        """
        layout, m = self._layout, len(self.kernel.terms)
        switched, q = np.zeros(m, bool), np.zeros((len(further), layout.further))
        switched[layout.terms], q[:, layout.given] = active, further
        out = np.zeros((len(further), m))
        points = (np.array(array, float) for array in (x, v, weight))
        widths = self._widths(self.epsilon if epsilon is None else epsilon)
        self.kernel.sums(*points, *widths, q, switched, out)
        return out[:, layout.terms]

    def _widths(self, epsilon: float) -> tuple[float, float]:
        """Return the ε of terms that jump where it is 0, and of terms that are rounded off."""
        return float(epsilon), float(epsilon) or ROUNDED * self.amplitude * self.frequency


def warm() -> None:
    """Compile the kernel of all that ships, so that the first record need not wait for it."""
    t, law = np.linspace(0.0, 1.0, 5), "linear"
    solver = Solver(SHIPPED, law, t, "angle", 0.1, 4.0, 0.01, np.linspace(0.0, 1.0, 4))
    values = {
        **LAWS.get(law).start(4.0, 0.0, {}),
        "theta0": 0.1,
        "exponent": 1.0,
        "reference_velocity": 0.4,
        "reference_amplitude": 0.1,
        "stribeck_velocity": 0.1,
    }
    p = np.array([values.get(name, 0.0) for name in solver.names])
    active = np.ones(len(SHIPPED), bool)
    solver.solve(p, active, tangents=ALL)
    solver.works(t, t, t, np.ones((1, len(solver.further))), active)
