"""Compute records of an oscillator at given times from parameters by name, with the compiled kernel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from bayesdamp.physics.forces import by_kernel, newton, rest_near
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS, QUANTITIES, Motion, Solver
from bayesdamp.physics.oscillator import POINTS, REACH, Oscillator
from bayesdamp.types import Refusal

STEPS_PER_CYCLE = 25.0
"""Steps whose errors add up in a cycle (measured at the default tolerance of `Solver.solve`)."""
LOST = 15.0
"""Factor by which the dense output loses accuracy with each derivative (measured on the laws that ship: 4 to 13)."""
COARSEST, FINEST = 1e-6, 1e-13
"""Largest and smallest error of a step, as a share of the amplitude: above the largest, the error no longer follows the
tolerance; the smallest is that of rounding."""
ROUNDING = 1e-12
"""Share of the angles below which an amplitude is just rounding."""
CHANGE, OF_A_RECORD = 1e-6, 1e-3
"""Relative change of a parameter in a central difference of a force, and of a record, which depends smoothly on its
parameters only within the tolerance. The error of the difference is the square of the change."""


class Trajectories:
    """Solve the motion of an oscillator at fixed times for any values of its parameters.

    The motion starts with theta0 and omega0 at the first time. Where a damping term needs `rest`, it is the equilibrium
    of the restoring law near the parameter `rest`, or near that of the reference where there is none.
    `reference_amplitude` and `reference_velocity` are those of the reference unless the parameters give them.

    Parameters
    ----------
    osc : Oscillator
    times : ndarray, shape (n,)
        Sample times in s, not decreasing.
    quantity : str
        "angle", "velocity" or "acceleration".
    reference : mapping of str to float
        Rough values of all parameters except the damping coefficients; they set the scales of amplitude and frequency.
    tolerance : float, optional
        Largest error of a record in its own unit, at the reference; 0 for the smallest possible. By default the
        solver's own.

    Raises
    ------
    Refusal
        Where the law, or at the first record a term, has no `kernel` that can be compiled.
    """

    def __init__(
        self,
        osc: Oscillator,
        times: np.ndarray,
        quantity: str,
        reference: Mapping[str, float],
        tolerance: float | None = None,
    ) -> None:
        self.osc = osc
        self._rests = "rest" in osc.scales
        t = np.asarray(times, float) - float(times[0])
        self._count = t.size
        rest, amplitude, frequency = _scales(osc, reference)
        self._given = {
            "rest": rest,
            "reference_amplitude": amplitude,
            "reference_velocity": amplitude * frequency,
        }
        if t[-1] <= 0.0:  # a step needs a length
            t = np.append(t, 1.0 / frequency)
        if not amplitude > ROUNDING * max(abs(rest), abs(float(reference["theta0"]))):
            amplitude = 1.0  # a body at rest
        self._solver = Solver(osc.damping, osc.restoring, t, quantity, amplitude, frequency, 0.0, t[[0, -1]])
        self._active = np.ones(len(osc.damping), bool)
        self._short: dict[float, Solver] = {}
        self._tolerance = None
        if tolerance is not None:  # the error of a step, as a share of the amplitude
            order = QUANTITIES.index(quantity)
            cycles = max(1.0, t[-1] * frequency / (2 * np.pi))
            share = tolerance / (amplitude * frequency**order)
            self._tolerance = float(
                np.clip(share / (STEPS_PER_CYCLE * cycles * LOST**order), FINEST, COARSEST)
            )

    def record(self, p: Mapping[str, float]) -> np.ndarray:
        """Return the samples, shape (n,); all nan where the motion escapes or has no equilibrium."""
        motion = self._solved(p, _epsilon(p), NONE)
        return np.full(self._count, np.nan) if motion is None else motion.y[: self._count]

    def with_slopes(self, p: Mapping[str, float], names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples, (n,), and their derivatives by the parameters of these names, (k, n).

        They include the effect of a parameter of the restoring law on `rest`. Those by epsilon are central differences.
        """
        motion = self._solved(p, _epsilon(p), PARAMETERS)
        if motion is None:
            return np.full(self._count, np.nan), np.full((len(names), self._count), np.nan)
        slopes = np.zeros((len(names), self._count))
        of_rest = self._slopes_of_rest(p) if self._rests else {}
        for row, name in zip(slopes, names, strict=True):
            epsilon = _epsilon(p)
            if (
                name == "epsilon" and epsilon > 0.0
            ):  # at 0 the energy that friction takes depends on its square
                ends = [self._solved(p, epsilon * (1.0 + sign * OF_A_RECORD), NONE) for sign in (1.0, -1.0)]
                up, down = (np.full(self._count, np.nan) if m is None else m.y[: self._count] for m in ends)
                row += (up - down) / (2.0 * OF_A_RECORD * epsilon)
            for place, own in enumerate(self._solver.names):
                if own == name or (own == "rest" and name in of_rest):
                    share = 1.0 if own == name else of_rest[name]
                    row += share * motion.tangents[: self._count, place]
        return motion.y[: self._count], slopes

    def motion(self, p: Mapping[str, float]) -> Motion | None:
        """Return the motion itself, with tangents by all of the kernel's parameters; None where it escapes."""
        return self._solved(p, _epsilon(p), PARAMETERS)

    def after(self, p: Mapping[str, float], gap: float) -> np.ndarray:
        """Return angle, velocity and acceleration, (3,), a time `gap` (s) after the start; NaN where it escapes."""
        if gap not in self._short:
            ends = np.array([0.0, max(gap, 1e-12 / self._solver.frequency)])
            self._short[gap] = replace(self._solver, t=ends, knots=ends, quantity="angle")
        motion = self._solved(p, _epsilon(p), NONE, self._short[gap])
        return np.full(3, np.nan) if motion is None else motion.states[-1, :3]

    @property
    def kernel_names(self) -> tuple[str, ...]:
        """Names of the kernel's parameters, in the order of a motion's tangents."""
        return self._solver.names

    def many(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the samples for each set of parameters, shape (m, n); values by name are of shape (m,)."""
        sets = zip(*(np.asarray(v, float).tolist() for v in values.values()), strict=True)
        return np.stack([self.record(dict(zip(values, numbers))) for numbers in sets])

    def _solved(
        self, p: Mapping[str, float], epsilon: float, tangents: int, solver: Solver | None = None
    ) -> Motion | None:
        values = {**self._given, **p}
        if self._rests:
            rest = self._rest(p)
            if rest is None:
                return None
            values["rest"] = rest
        if epsilon != self._solver.epsilon:
            self._solver = _with_epsilon(self._solver, epsilon)
        if solver is None:
            solver = self._solver
        elif epsilon != solver.epsilon:
            solver = _with_epsilon(solver, epsilon)
        vector = np.array([float(values[name]) for name in solver.names])
        return solver.solve(vector, self._active, tangents=tangents, tolerance=self._tolerance)

    def _rest(self, p: Mapping[str, float]) -> float | None:
        """Return the equilibrium of the restoring law at p; None where there is none nearby."""
        force = _force(self.osc, p)
        return newton(lambda x: (force(x), _slope(force, x)), float(p.get("rest", self._given["rest"])))

    def _slopes_of_rest(self, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the equilibrium by the law's parameters (implicit function theorem)."""
        rest = self._rest(p)
        if rest is None:
            return {}
        stiffness = _slope(_force(self.osc, p), rest)
        slopes = {}
        for name in self.osc.law.parameters:
            slope = _slope(lambda v, name=name: _force(self.osc, {**p, name: v})(rest), float(p[name]))
            slopes[name] = -slope / stiffness
        return slopes


def _epsilon(p: Mapping[str, float]) -> float:
    """Return the width of friction's switch, rad/s; 0 where it is the sign of the velocity."""
    return float(p.get("epsilon", 0.0))


def _with_epsilon(solver: Solver, epsilon: float) -> Solver:
    """Return a copy of the solver with another width of friction's switch, which shares what does not depend on it."""
    changed = copy(solver)
    object.__setattr__(changed, "epsilon", epsilon)
    return changed


def _scales(osc: Oscillator, p: Mapping[str, float]) -> tuple[float, float, float]:
    """Return the equilibrium nearest to theta0, the amplitude about it, and the frequency there, rad/s.

    Without a stable equilibrium the motion escapes, and the scales are those of its start.
    """
    theta0, omega0 = float(p["theta0"]), float(p["omega0"])
    law = np.array([float(p[name]) for name in osc.law.parameters])
    force = _force(osc, p)
    try:
        rest = rest_near(by_kernel(osc.law.kernel, law), theta0, REACH * max(1.0, abs(theta0)), POINTS)
    except NotImplementedError:
        raise Refusal(
            f"the restoring law {osc.restoring!r} has no `kernel`, which trajectories need"
        ) from None
    square = 0.0 if rest is None else _slope(force, rest)
    if rest is None or not square > 0.0:
        return theta0, abs(theta0), 1.0
    frequency = float(np.sqrt(square))
    return rest, float(np.hypot(theta0 - rest, omega0 / frequency)), frequency


def _force(osc: Oscillator, p: Mapping[str, float]) -> Callable[[float], float]:
    """Return the restoring force as a function of the position."""
    law = [float(p[name]) for name in osc.law.parameters]
    return lambda x: osc.law.kernel(x, law)


def _slope(function: Callable[[float], float], x: float) -> float:
    """Return the derivative of a smooth function at x, by a central difference."""
    h = CHANGE * max(1.0, abs(x))
    return (function(x + h) - function(x - h)) / (2.0 * h)


def simulate(
    osc: Oscillator,
    p: Mapping[str, float],
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Return the record of an oscillator that starts with theta0 and omega0 at the first time.

    Parameters
    ----------
    osc
        The oscillator.
    p
        All its parameters, by name.
    times
        Times in s, shape (n,), not decreasing.
    quantity
        "angle", "velocity" or "acceleration".
    tolerance
        Largest error in the unit of the quantity.

    Returns
    -------
    ndarray
        The quantity at the times, shape (n,); NaN where the motion escapes.

    Raises
    ------
    ValueError
        Where a parameter is missing or the quantity is unknown.
    """
    missing = [name for name in osc.parameters if name not in p]
    if missing:
        raise ValueError(f"parameter {missing[0]!r} is missing; needed are {', '.join(osc.parameters)}")
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity {quantity!r} is not one of {', '.join(QUANTITIES)}")
    return Trajectories(osc, times, quantity, p, tolerance).record(p)
