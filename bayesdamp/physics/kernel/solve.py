"""Solve the equation of motion at the times of a record with a compiled kernel, with derivatives by the parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from bayesdamp.machine import interruptible
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel.build import Kernel, kernel_of, most_parameters
from bayesdamp.physics.restoring import LAWS

TOLERANCE = 3e-8
"""Default of the largest error of an integration step, relative to the amplitude (conventional)."""
MAX_STEPS_PER_CYCLE = 4000
"""Greatest mean number of integration steps per cycle. If a trajectory needs more, it is treated like one that escapes
to infinity (conventional)."""
ROUNDED = 5e-4
"""Fraction of the peak velocity within which forces that are steep but continuous at v = 0 are smoothed if ε, the width
in which dry friction changes its sign, is 0 (conventional)."""
PARTS = 3
"""Number of parts into which `Motion.refined` divides each integration step, so that integrals over time by the
trapezoidal rule are accurate enough (conventional)."""
QUANTITIES = ("angle", "velocity", "acceleration")
"""Quantities that a record can contain; the index in this tuple is the order of the time derivative of the angle."""
NONE, PARAMETERS, ALL = 0, 1, 2
"""Values of the argument `tangents` of `Solver.solve`, which selects the derivatives to compute. `NONE`: none.
`PARAMETERS`: by the parameters. `ALL`: by the parameters, and by the relative deviations g of the damping and h of the
frequency."""
SHIPPED = (*PAPER_TERMS, "displacement", "stribeck", "power", "cubic", "structural", "dry_position")
"""Names of the damping terms in the shared kernel (compiled equation of motion). It is compiled only once for all
oscillators with these terms and the restoring laws in `SHIPPED_LAWS`."""
SHIPPED_LAWS = ("horizontal_pendulum", "linear", "pendulum", "duffing")
"""Names of the restoring laws in the shared kernel (compiled equation of motion), together with the damping terms in
`SHIPPED`."""


@dataclass(frozen=True)
class Slopes:
    """Tangents (derivatives of a motion by its parameters) at the nodes of the integration.

    Nodes are the ends of the integration steps; tangents at the samples are interpolated between them.

    Attributes
    ----------
    times
        Times of the s nodes in s, (s,).
    slopes
        For each of the k parameters of the kernel (with `ALL` also g and h at the knots): the tangent of the angle, its
        first and second time derivative, and the factor of the correction between the nodes (see `dense`), (s, k, 4).
    columns
        Indices, among these k, of the p tangents that the solver returns, (p,). The kernel can have more parameters.
    t
        Times of the samples in s, (n, m). Each tangent is averaged over the m times of a row.
    order
        0 for tangents of the angle, 1 of the velocity, 2 of the acceleration.
    """

    times: np.ndarray
    slopes: np.ndarray
    columns: np.ndarray
    t: np.ndarray
    order: int

    def at_samples(self) -> np.ndarray:
        """Return the tangents by interpolation, averaged over the times in each row of `t`, (n, p).

        A tangent is the derivative of the recorded quantity by one of p parameters.
        """
        from bayesdamp.physics.kernel.dense import slopes_at_times

        return slopes_at_times(
            self.times, self.slopes, self.columns, self.t.ravel(), self.t.shape[1], self.order
        )


@dataclass(frozen=True)
class Motion:
    """A trajectory at the times of the samples and at the nodes (ends of the steps) of the integration.

    Attributes
    ----------
    y : ndarray, shape (n,)
        Values of the recorded quantity at the samples. If `Solver.samples` is given: its means over the n windows.
    slopes : ndarray, shape (n, k), or Slopes
        Derivatives of y by the k parameters, or an object from which `tangents` computes them; k is 0 if none were
        wanted.
    times : ndarray, shape (s,)
        Times of the nodes in s.
    states : ndarray, shape (s, 4)
        θ, θ̇, θ̈ at the nodes, and the factor k of the correction k u³(1 − u)³ that is added to the interpolation at the
        fraction u of the step after each node. An `AmplitudeSolver` gives x and dx/dt instead, (s, 2).
    """

    y: np.ndarray
    slopes: np.ndarray | Slopes
    times: np.ndarray
    states: np.ndarray

    @cached_property
    def tangents(self) -> np.ndarray:
        """Return the derivatives of the values at the samples by the parameters, (n, k)."""
        return self.slopes.at_samples() if isinstance(self.slopes, Slopes) else self.slopes

    def without_tangents(self) -> Motion:
        """Return the motion with an empty array, (n, 0), in place of its derivatives, to save memory."""
        return Motion(self.y, np.zeros((self.y.size, 0)), self.times, self.states)

    @cached_property
    def refined(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times, (r,), that divide each integration step into `PARTS` parts, and θ, θ̇, θ̈ at them, (r, 3).

        A time at which the acceleration jumps occurs twice, with the values before and after the jump.
        """
        from bayesdamp.physics.kernel.dense import at_times

        steps = np.diff(self.times)
        times = self.times[:-1, None] + steps[:, None] * np.arange(PARTS) / PARTS
        values = [at_times(self.times, self.states, times.ravel(), order) for order in range(3)]
        states = np.stack(values, axis=-1).reshape(-1, PARTS, 3)
        states[:, 0] = self.states[:-1, :3]
        ends = (steps[:, None] > 0) | (np.arange(PARTS) == 0)
        return np.append(times[ends], self.times[-1:]), np.vstack([states[ends], self.states[-1:, :3]])

    @cached_property
    def half_cycles(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times in s and amplitudes (rad or m) of the half cycles, as two arrays of the same length.

        An amplitude is half the distance between two turning points; its time is the middle between them. An amplitude
        that is larger than the previous one is replaced by the previous one, so that the amplitudes never grow. Half
        cycles of zero amplitude are left out. Both arrays are empty if there are fewer than two turning points. For an
        averaged record (one reduced to amplitudes and phases) the motion and its times are those of the compressed
        oscillation that is solved in its place, which decays through the same amplitudes in fewer cycles.
        """
        times, states = self.refined
        v = states[:, 1]
        # Turning points: the velocity changes sign between two nodes, or reaches zero at a node (counted once).
        reached = (v[:-1] != 0) & (v[1:] == 0)
        reached[0] |= v[0] == 0
        turns = np.flatnonzero((v[:-1] * v[1:] < 0) | reached)
        share = v[turns] / np.where(v[turns] == v[turns + 1], 1.0, v[turns] - v[turns + 1])
        h = times[turns + 1] - times[turns]
        t = times[turns] + share * h
        x = states[turns, 0] + h * share * (states[turns, 1] + 0.5 * h * share * states[turns, 2])
        sizes, at = 0.5 * np.abs(np.diff(x)), 0.5 * (t[1:] + t[:-1])
        good = sizes > 0
        return at[good], np.minimum.accumulate(sizes[good])


@dataclass(frozen=True)
class Solver:
    """Solve the equation of motion of an oscillator at fixed times, from time 0.

    Attributes
    ----------
    terms, restoring
        Names of the damping terms, any of which can be switched off in `solve`, and name of the restoring law.
    t
        Times of the samples in s, not decreasing, (n,); not used if `samples` is given.
    quantity
        The recorded quantity, whose values `solve` computes: "angle" (the displacement), "velocity" or "acceleration".
    amplitude, frequency
        Typical amplitude (rad or m) and angular frequency (rad/s). From them follow the tolerances, and the limits of
        displacement and number of steps beyond which a trajectory is given up.
    epsilon
        Width ε of the range of velocities, rad/s or m/s, in which dry friction changes its sign. With 0 friction is
        discontinuous, and the body may stick.
    knots
        Increasing times in s, (k,), at which the relative deviations g of the damping and h of the frequency are given;
        between these times, g and h are linear. The first is 0, and no sample may be after the last.
    samples
        Times in s of the m samples in each of n windows, (n, m), increasing. If given, values are means over these
        windows instead of values at t.
    """

    terms: tuple[str, ...]
    restoring: str
    t: np.ndarray
    quantity: str
    amplitude: float
    frequency: float
    epsilon: float
    knots: np.ndarray
    samples: np.ndarray | None = None

    @property
    def slowness(self) -> float:
        """Return the number of the record's cycles for each integrated cycle: 1 here, and more in `AveragedSolver`."""
        return 1.0

    def at(self, t: np.ndarray, quantity: str) -> Solver:
        """Return a solver for another quantity at other times t in s, (n,), without averages over windows.

        No time may be after the last of the knots, the times at which deviations from the laws are given. quantity:
        "angle" (the displacement), "velocity" or "acceleration".
        """
        return replace(self, t=t, quantity=quantity, samples=None)

    @cached_property
    def kernel(self) -> Kernel:
        """Return the compiled equation of motion for the damping terms and the restoring law.

        All terms that ship with bayesdamp are in one kernel, together with all laws that ship. If a term is not among
        them, the kernel contains only the solver's terms; if the law is not among them, it contains only this law.
        Raises Refusal if a term or the law has no method `kernel` that can be compiled.
        """
        terms = SHIPPED if set(self.terms) <= set(SHIPPED) else self.terms
        return kernel_of(terms, SHIPPED_LAWS if self.restoring in SHIPPED_LAWS else (self.restoring,))

    @cached_property
    def further(self) -> tuple[str, ...]:
        """Return the names of the parameters that the damping forces need besides coefficients and ε, term by term.

        They include the equilibrium and the reference scales (`DampingTerm.further`). ε is the width of the range of
        velocities in which dry friction changes its sign.
        """
        return tuple(n for name in self.terms for n in TERMS.get(name).further)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of the parameters that `solve` takes, in order.

        They are the coefficients of the damping terms, the other arguments of their forces (`further`, with equilibrium
        and reference scales), the parameters of the restoring law, and the angle and velocity at the start (theta0,
        omega0). ε is not among them.
        """
        coefficients = tuple(TERMS.get(name).parameter for name in self.terms)
        return (*coefficients, *self.further, *LAWS.get(self.restoring).parameters, "theta0", "omega0")

    @cached_property
    def law_places(self) -> slice:
        """Return the slice of `names` that contains the restoring law's parameters."""
        first = len(self.terms) + len(self.further)
        return slice(first, first + len(LAWS.get(self.restoring).parameters))

    @cached_property
    def inferred(self) -> tuple[str, ...]:
        """Return the names of the parameters, other than coefficients, that are inferred for the damping terms.

        They are listed term by term.
        """
        return tuple(p.name for name in self.terms for p in TERMS.get(name).inferred)

    @cached_property
    def _sections(self) -> np.ndarray:
        """Return three indices that split the array of the kernel's parameters into four parts, (3,).

        The parts are: coefficients, further parameters of the damping terms, parameters of the restoring law, and angle
        and velocity at the start. The kernel may have more damping terms and restoring laws than the solver.
        """
        terms, laws = self.kernel.terms, self.kernel.laws
        further = sum(len(TERMS.get(name).further) for name in terms)
        return np.cumsum([len(terms), further, most_parameters(laws)])

    @cached_property
    def _places(self) -> np.ndarray:
        """Return the index of each of the solver's parameters (`names`) among those of its kernel, (k,)."""
        terms, (m, first_of_law, start) = self.kernel.terms, self._sections
        every = [(name, n) for name in terms for n in TERMS.get(name).further]
        own = [every.index((name, n)) for name in self.terms for n in TERMS.get(name).further]
        law = first_of_law + np.arange(len(LAWS.get(self.restoring).parameters))
        coefficients = [terms.index(name) for name in self.terms]
        return np.concatenate([coefficients, m + np.array(own, int), law, [start, start + 1]])

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
        epsilon: float | None = None,
    ) -> Motion | None:
        """Integrate the equation of motion; return None if the trajectory escapes to infinity or needs too many steps.

        Parameters
        ----------
        p
            Parameters in the order of `names`, (k,).
        active
            Which terms are switched on, (m,) of bool.
        g, h
            Relative deviations of the damping and of the frequency at the knots, (knots,); 0 by default. The damping
            force has the factor 1 + g, the restoring force the factor 1 + 2h. If both are None and the samples end
            before the last knot, the knots are replaced by two: 0 and the time of the last sample.
        tangents
            Which derivatives to compute: `NONE`, by `PARAMETERS`, or by `ALL` (parameters, g and h).
        stop
            Number of samples (or windows, with `samples`) to compute, from the first on; all by default.
        tolerance
            Largest error of a step, relative to the amplitude; `TOLERANCE` by default.
        epsilon
            Width ε in rad/s or m/s of the range of velocities in which dry friction changes its sign; by default the
            solver's.

        Returns
        -------
        Motion
            Its values are means over `samples` if these are given. Its derivatives are by p, in the order of `names`.
            With `ALL`, derivatives by g, then by h, at the knots follow.
        """
        from bayesdamp.physics.kernel.dense import at_times

        # Writable copies: Numba would compile again for an array that is read-only.
        t = np.array((self.t[:, None] if self.samples is None else self.samples)[:stop], float)
        knots, end = self.knots, float(t[-1, -1])
        if g is None and h is None and end < knots[-1]:
            knots = np.array([0.0, end])
        g, h = (np.zeros(knots.size) if d is None else np.asarray(d, float) for d in (g, h))
        most = int(MAX_STEPS_PER_CYCLE * max(1.0, end * self.frequency / (2 * np.pi)))
        every, switched = np.zeros(self._sections[-1] + 2), np.zeros(len(self.kernel.terms), bool)
        every[self._places], switched[self._places[: len(self.terms)]] = p, active
        m, first_of_law, first_of_start = self._sections.tolist()
        law = np.append(every[first_of_law:first_of_start], self.kernel.laws.index(self.restoring))
        widths = self._widths(self.epsilon if epsilon is None else epsilon)
        times, states, slopes = interruptible(self.kernel.march)(
            every[:m], every[m:first_of_law], switched, law, *widths, every[first_of_start:],
            knots, g, h, tolerance or TOLERANCE, self._sizes, tangents, most,
        )  # fmt: skip
        if times.size == 0:
            return None
        order = QUANTITIES.index(self.quantity)
        y = at_times(times, states, t.ravel(), order).reshape(t.shape).mean(axis=1)
        if not tangents:
            return Motion(y, np.zeros((y.size, 0)), times, states)
        columns = np.append(self._places, np.arange(every.size, slopes.shape[1]))
        return Motion(y, Slopes(times, slopes, columns, t, order), times, states)

    def works(
        self,
        x: np.ndarray,
        v: np.ndarray,
        weight: np.ndarray,
        further: np.ndarray,
        active: np.ndarray,
        epsilon: float | None = None,
    ) -> np.ndarray:
        """Return sums over n points of weight times damping force, (d, m), for each of the solver's m terms.

        The force of each term is per unit of its coefficient.

        Parameters
        ----------
        x, v, weight
            Displacement (rad), velocity (rad/s) and weight of each point, (n,).
        further
            Values of the parameters named in `Solver.further`, (d, e): d sets, each of which gives one row of sums.
        active
            Which terms are switched on, (m,) of bool; the sums of the others are 0.
        epsilon
            Width ε in rad/s of the range of velocities in which dry friction changes its sign; by default the solver's.
        """
        m, first_of_law, _ = self._sections
        terms = self._places[: len(self.terms)]
        own = self._places[terms.size : self.law_places.start]
        switched, q = np.zeros(m, bool), np.zeros((len(further), first_of_law - m))
        switched[terms], q[:, own - m] = active, further
        out = np.zeros((len(further), m))
        points = (np.array(array, float) for array in (x, v, weight))
        widths = self._widths(self.epsilon if epsilon is None else epsilon)
        self.kernel.sums(*points, *widths, q, switched, out)
        return out[:, terms]

    def _widths(self, epsilon: float) -> tuple[float, float]:
        """Return two velocity widths: of the sign change of dry friction, and of forces that are steep at v = 0.

        They are equal to `epsilon` (rad/s), except that the second is never 0: it is then `ROUNDED` times the peak
        velocity.
        """
        return float(epsilon), float(epsilon) or ROUNDED * self.amplitude * self.frequency


def warm() -> None:
    """Compile the shared kernel in advance, so that the first record does not wait for it.

    The shared kernel is the equation of motion with all damping terms and restoring laws that ship with bayesdamp.
    """
    t = np.linspace(0.0, 1.0, 5)
    solver = Solver(SHIPPED, "linear", t, "angle", 0.1, 4.0, 0.01, np.linspace(0.0, 1.0, 4))
    p = np.full(len(solver.names), 0.1)
    active = np.ones(len(SHIPPED), bool)
    solver.solve(p, active, tangents=ALL)
    solver.works(t, t, t, np.ones((1, len(solver.further))), active)
