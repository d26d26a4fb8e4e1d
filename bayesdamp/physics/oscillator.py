"""Define an oscillator (a sum of damping terms and a restoring law), and compute its trajectories."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.damping import TERMS, DampingTerm, parse_model
from bayesdamp.physics.forces import bracket, by_kernel, frequency_over, newton, newton_many, rest_near
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS, QUANTITIES, Motion, Solver
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import FeatureValues, InputError, Reference, Refusal, System

Parameters = Mapping[str, float | np.ndarray]
"""Values of an oscillator's parameters by name, as scalars or arrays."""
SEARCH_REACH, SEARCH_POINTS = 10.0, 4001
"""Half-width (rad or m) and number of points of the grid on which an equilibrium is searched (conventional)."""
NEWTON_STEPS = 4
"""Number of Newton steps from an approximate to the exact equilibrium. From 0.1 rad away, the error is then 1e-15 or
less."""


@dataclass(frozen=True, init=False)
class Oscillator:
    """The oscillator θ̈ + F_damp(θ, θ̇) + F_rest(θ) = 0, with forces per unit of inertia.

    Its methods take the values of its parameters as a mapping of names to numbers.

    Parameters
    ----------
    damping
        Names of the damping terms, or one string with their sum, such as `viscous+coulomb`.
    restoring
        Name of the restoring law.

    Raises
    ------
    InputError
        If `damping` is a string that `parse_model` refuses, for example with an unknown or repeated term. Names in a
        sequence and the name of the law are not checked here: an unknown one raises InputError when it is used.
    """

    damping: tuple[str, ...]
    restoring: str

    def __init__(self, damping: str | Sequence[str], restoring: str) -> None:
        terms = parse_model(damping) if isinstance(damping, str) else tuple(damping)
        object.__setattr__(self, "damping", terms)
        object.__setattr__(self, "restoring", restoring)

    @property
    def terms(self) -> tuple[DampingTerm, ...]:
        """Return the damping terms as objects, in the order of their names in `damping`."""
        return tuple(TERMS.get(name) for name in self.damping)

    @property
    def law(self) -> RestoringLaw:
        """Return the restoring law as an object."""
        return LAWS.get(self.restoring)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Return the names of the damping coefficients, in the order of the terms."""
        return tuple(term.parameter for term in self.terms)

    @property
    def further(self) -> tuple[str, ...]:
        """Return the names of the damping terms' inferred parameters other than their coefficients.

        Unlike `DampingTerm.further`, they do not include the equilibrium and the reference scales, which are not
        inferred.
        """
        return tuple(p.name for term in self.terms for p in term.inferred)

    @property
    def switches(self) -> bool:
        """Return whether the force of any damping term depends on ε, so that ε is a parameter of the oscillator.

        ε is the width of the range of velocities in which dry friction changes its sign (`DampingTerm.switches`).
        """
        return any(term.switches for term in self.terms)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Return the names of all parameters of the motion.

        In this order, they are the damping coefficients, the terms' other inferred parameters, the parameters of the
        restoring law, epsilon (width of the velocity within which dry friction changes its sign) if a term needs it,
        and the angle and velocity at the start (theta0, omega0).
        """
        epsilon = ("epsilon",) if self.switches else ()
        return (*self.coefficients, *self.further, *self.law.parameters, *epsilon, "theta0", "omega0")

    @property
    def scales(self) -> tuple[str, ...]:
        """Return the names of the equilibrium and the reference scales that the damping terms need.

        They are `rest`, `reference_velocity` and `reference_amplitude`, as far as a term needs them, each listed once.
        """
        return tuple(dict.fromkeys(n for term in self.terms for n in term.given))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Return the names of all numbers that determine a motion.

        They are the `parameters`, then the equilibrium and reference scales that the damping terms need (`scales`).
        """
        return (*self.parameters, *self.scales)

    def damping_force(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> np.ndarray:
        """Return the total damping force F_damp(θ, θ̇) per unit of inertia, in rad/s² (or m/s²).

        theta, omega: displacements θ in rad (or m) and velocities θ̇ in rad/s (or m/s), arrays of one shape. p:
        parameters by name, which broadcast against these arrays: the damping coefficients, and all parameters that
        `shapes` needs.
        """
        total = np.zeros(np.shape(omega))
        for term, shape in zip(self.terms, self.shapes(theta, omega, p), strict=True):
            total = total + p[term.parameter] * shape
        return total

    def shapes(self, theta: ArrayLike, omega: ArrayLike, p: Parameters) -> list[np.ndarray]:
        """Return the force of each damping term per unit of its coefficient, as one array for each term.

        theta, omega: displacements in rad (or m) and velocities in rad/s (or m/s), arrays of one shape. p: parameters
        by name, which broadcast against these arrays:

        - the further parameters of the terms, and the numbers named in `scales`;
        - if `rest` is one of these, the parameters of the restoring law, from which the exact equilibrium is computed;
        - epsilon, the width of the velocity within which dry friction changes its sign; 0 if it is missing.
        """
        p = self.with_equilibrium(p)
        return [t.force(theta, omega, p.get("epsilon", 0.0), *(p[n] for n in t.further)) for t in self.terms]

    def with_equilibrium(self, p: Parameters) -> Parameters:
        """Return the parameters with the approximate equilibrium `rest` replaced by the exact one (`newton_many`).

        They are unchanged if no damping term needs the equilibrium. p: parameters by name, among them `rest` and those
        of the restoring law, as numbers or arrays that broadcast.
        """
        if "rest" not in self.scales:
            return p
        shape = np.broadcast_shapes(*(np.shape(p[n]) for n in (*self.law.parameters, "rest")))
        near = np.broadcast_to(p["rest"], shape)
        return {**p, "rest": newton_many(lambda at: self.law.force(at, p), near, NEWTON_STEPS)}

    def equilibrium(self, p: Parameters, near: float = 0.0) -> float:
        """Return the stable equilibrium nearest to `near`; both are in rad, or in m if the displacement is a length.

        p: parameters by name; only those of the restoring law are used. Raises ValueError if there is no stable
        equilibrium within the distance `SEARCH_REACH` of `near`.
        """
        return _equilibrium(self.restoring, tuple(_law_values(self, p)), float(near))

    def natural_frequency(self, p: Parameters, near: float = 0.0) -> float:
        """Return the natural frequency ω_n in rad/s at the stable equilibrium nearest to `near` (rad or m).

        It is the square root of the slope of the restoring force there. p: parameters by name; only those of the
        restoring law are used. Raises ValueError if there is no stable equilibrium within the distance `SEARCH_REACH`
        of `near`.
        """
        return float(np.sqrt(self.law.slope(self.equilibrium(p, near), p)))

    def rough_frequency(self, p: Parameters, near: float = 0.0, reach: float = SEARCH_REACH) -> float:
        """Return the natural frequency in rad/s with an error of about 0.1 %, with less work than `natural_frequency`.

        It is the frequency at the stable equilibrium nearest to `near`. The derivative of the restoring force is
        approximated by a difference quotient over the grid step that contains the equilibrium. p: parameters by name;
        only those of the restoring law are used. Raises ValueError if no stable equilibrium is within the distance
        `reach` of `near` (rad or m).
        """
        force = by_kernel(self.law.kernel, np.array(_law_values(self, p)))
        ends = bracket(force, near, reach, SEARCH_POINTS)
        if ends is None:
            raise _no_rest(self.restoring, near, reach)
        return frequency_over(force, *ends)


def _law_values(osc: Oscillator, p: Parameters) -> list[float]:
    """Return the values of the restoring law's parameters as its `kernel` takes them. p: parameters by name."""
    return [float(p[name]) for name in osc.law.parameters]


def _no_rest(restoring: str, near: float, reach: float) -> ValueError:
    return ValueError(f"the law {restoring} has no stable equilibrium within {reach:g} of {near:.3g}")


@lru_cache(maxsize=4096)
def _equilibrium(restoring: str, values: tuple[float, ...], near: float) -> float:
    p = dict(zip(LAWS.get(restoring).parameters, values))
    law = LAWS.get(restoring)
    rest = rest_near(lambda x: law.force(x, p), near, SEARCH_REACH, SEARCH_POINTS)
    if rest is None:
        raise _no_rest(restoring, near, SEARCH_REACH)
    return rest


def check_restoring(restoring: str, known: Mapping[str, float]) -> None:
    """Raise InputError if a known parameter is not above 0 although the restoring law requires this.

    restoring: name of the law; `RestoringLaw.positive` names the parameters that must be above 0. known: known values
    of parameters, by name.
    """
    for name in LAWS.get(restoring).positive:
        if name in known and not known[name] > 0:
            raise InputError(f"{name} = {known[name]:g}: it must be above 0 under the law {restoring}")


def reference_of(system: System, features: FeatureValues) -> Reference:
    """Return the reference amplitude (rad or m) and angular frequency (rad/s), with which the widths of priors scale.

    Each of the two is the first of these values that is available:

    - the value that `system` states;
    - if all parameters of the restoring law are known: for the frequency, the natural frequency at the equilibrium θ_e;
      for the amplitude, |θ₀ − θ_e|, if theta0 is known too and the result is not 0;
    - the value measured on the record (amplitude at its first sample, mean frequency), to two significant digits.

    features: measured features of the record.

    Raises
    ------
    InputError
        If a known parameter is not above 0 although the law requires this (`check_restoring`), or no oscillation about
        the record's midline is possible with the known parameters of the law.
    """
    amplitude, frequency = system.amplitude, system.frequency
    check_restoring(system.restoring, system.known)
    law, osc = LAWS.get(system.restoring), Oscillator(("viscous",), system.restoring)
    known = {n: system.known[n] for n in law.parameters if n in system.known}
    rest = features.rest
    try:
        if known:
            reach = SEARCH_REACH * max(1.0, features.amplitude)
            osc.rough_frequency(law.start(features.frequency, rest, known), rest, reach)
        if len(known) == len(law.parameters):
            if frequency is None:
                frequency = osc.natural_frequency(system.known, rest)
            if amplitude is None and "theta0" in system.known:
                amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, rest)) or None
    except (ValueError, ZeroDivisionError):
        each = ", ".join(f"{name} = {value:g}" for name, value in known.items())
        raise InputError(
            f"{each}: with these values the law {law.name} has no stable equilibrium near the record's midline "
            f"({rest:.3g}); correct the values or leave them out, so that they are inferred"
        ) from None
    amplitude = amplitude or float(f"{features.amplitude:.1e}")
    return Reference(amplitude, frequency or float(f"{features.frequency:.1e}"))


STEPS_PER_CYCLE = 25.0
"""Assumed number of integration steps per cycle. The tolerance of a step is the allowed error of a trajectory, divided
by this number and the number of cycles, because the errors of steps add up (measured at the default tolerance of
`Solver.solve`)."""
DERIVATIVE_LOSS = 15.0
"""Factor by which the relative error of a trajectory between the nodes of the integration grows with each time
derivative (measured for the shipped restoring laws: 4 to 13)."""
MAX_TOLERANCE, MIN_TOLERANCE = 1e-6, 1e-13
"""Largest and smallest tolerance of a step of the solver, relative to the amplitude. With larger tolerances the error
of a trajectory no longer follows the tolerance; smaller ones are below the rounding error."""
ROUNDING = 1e-12
"""The body counts as at rest if the amplitude is at most this fraction of the start angle or of the equilibrium
(whichever is larger in magnitude), because such a small amplitude is only a rounding error."""
FORCE_STEP, RECORD_STEP = 1e-6, 1e-3
"""Relative step of central differences: `FORCE_STEP` for a force, `RECORD_STEP` for a trajectory, which is smooth in
its parameters only within the tolerance of the solver. The relative error of a difference is of the order of the step
squared."""


class Trajectories:
    """Compute trajectories of an oscillator at fixed times, for any values of its parameters.

    The methods `record` (one set of parameters), `many` (several sets) and `with_slopes` (one set, with derivatives)
    take the values of the parameters by name, and return samples. The object itself is not callable.

    Each trajectory starts with theta0 and omega0 at the first time. If a damping term needs the equilibrium `rest`, it
    is computed for each set of parameters. Newton's method then starts from the value of `rest` among the parameters
    or, if this is missing, from the equilibrium of `reference`. The scales `reference_amplitude` and
    `reference_velocity` follow from `reference` unless they are among the parameters.

    Parameters
    ----------
    osc : Oscillator
        The oscillator: damping terms and restoring law.
    times : ndarray, shape (n,)
        Sample times in s, not decreasing.
    quantity : str
        "angle", "velocity" or "acceleration".
    reference : mapping of str to float
        Rough values of theta0, omega0 and the parameters of the restoring law, by name; others have no effect. They set
        the scales of amplitude and frequency from which the tolerances of the solver follow.
    tolerance : float, optional
        Largest error of the samples in their unit (base units: rad or m, and s), for parameters near the reference; 0
        for the smallest possible error. By default the error of each step is `kernel.solve.TOLERANCE`, relative to the
        amplitude.

    Raises
    ------
    Refusal
        If the restoring law has no `kernel`. A damping term without one is refused at the first trajectory.
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
        self._given = Reference(amplitude, frequency).scales(rest)
        if t[-1] <= 0.0:  # the solver needs a positive duration
            t = np.append(t, 1.0 / frequency)
        if not amplitude > ROUNDING * max(abs(rest), abs(float(reference["theta0"]))):
            amplitude = 1.0  # the body is at rest
        self._solver = Solver(osc.damping, osc.restoring, t, quantity, amplitude, frequency, 0.0, t[[0, -1]])
        self._active = np.ones(len(osc.damping), bool)
        self._tolerance = None
        if tolerance is not None:  # convert to the error of one step, relative to the amplitude
            order = QUANTITIES.index(quantity)
            cycles = max(1.0, t[-1] * frequency / (2 * np.pi))
            share = tolerance / (amplitude * frequency**order)
            share /= STEPS_PER_CYCLE * cycles * DERIVATIVE_LOSS**order
            self._tolerance = float(np.clip(share, MIN_TOLERANCE, MAX_TOLERANCE))

    def record(self, p: Mapping[str, float]) -> np.ndarray:
        """Return the samples of the quantity, (n,), for one set of parameters; all NaN if the trajectory diverges.

        p: parameters by name. All parameters of the oscillator are necessary except epsilon (width of the velocity
        within which dry friction changes its sign), which is 0 by default. The samples are also NaN if the solver needs
        too many steps, or if a damping term needs the equilibrium and none is found.
        """
        motion = self._solve(p, NONE)
        return np.full(self._count, np.nan) if motion is None else motion.y[: self._count]

    def with_slopes(self, p: Mapping[str, float], names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Return the samples of the trajectory, (n,), and their derivatives by the k parameters in `names`, (k, n).

        p: values of all parameters, by name; epsilon is 0 if it is missing. Derivatives by parameters of the restoring
        law include their effect on the equilibrium `rest`. The derivative by epsilon is a central difference, and 0 at
        epsilon = 0. If the motion does not depend on a name, the derivative by it is 0. All results are NaN if the
        samples that `record` returns are.
        """
        motion, epsilon = self._solve(p, PARAMETERS), float(p.get("epsilon", 0.0))
        if motion is None:
            return np.full(self._count, np.nan), np.full((len(names), self._count), np.nan)
        slopes = np.zeros((len(names), self._count))
        of_rest = self._slopes_of_rest(p) if self._rests else {}
        for row, name in zip(slopes, names, strict=True):
            # At epsilon = 0 the derivative is zero: the dissipated energy depends on epsilon squared.
            if name == "epsilon" and epsilon > 0.0:
                changed = (epsilon * (1.0 + RECORD_STEP), epsilon * (1.0 - RECORD_STEP))
                up, down = (self.record({**p, "epsilon": width}) for width in changed)
                row += (up - down) / (2.0 * RECORD_STEP * epsilon)
            for place, own in enumerate(self._solver.names):
                if own == name or (own == "rest" and name in of_rest):
                    share = 1.0 if own == name else of_rest[name]
                    row += share * motion.tangents[: self._count, place]
        return motion.y[: self._count], slopes

    def many(self, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the samples of m trajectories, (m, n), for m sets of parameters, each as `record` returns them.

        values: for each parameter an array (m,), by name; epsilon is 0 if it is missing. All samples of a trajectory
        are NaN if it diverges or needs too many steps, or if a damping term needs the equilibrium and none is found.
        """
        sets = zip(*(np.asarray(v, float).tolist() for v in values.values()), strict=True)
        return np.stack([self.record(dict(zip(values, numbers))) for numbers in sets])

    def _solve(self, p: Mapping[str, float], tangents: int) -> Motion | None:
        values = {**self._given, **p}
        if self._rests:
            rest = self._rest(p)
            if rest is None:
                return None
            values["rest"] = rest
        vector = np.array([float(values[name]) for name in self._solver.names])
        accuracy, epsilon = self._tolerance, float(p.get("epsilon", 0.0))
        return self._solver.solve(
            vector, self._active, tangents=tangents, tolerance=accuracy, epsilon=epsilon
        )

    def _rest(self, p: Mapping[str, float]) -> float | None:
        """Return the equilibrium of the restoring law with parameters p; None if Newton's method does not reach one.

        The method starts at `rest` in p or, if this is missing, at the equilibrium of the reference parameters.
        """
        force = _force(self.osc, p)
        return newton(lambda x: (force(x), _slope(force, x)), float(p.get("rest", self._given["rest"])))

    def _slopes_of_rest(self, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the equilibrium by the law's parameters, by name; empty if there is no equilibrium.

        They follow from the implicit function theorem. p: values of all parameters of the oscillator, by name.
        """
        rest = self._rest(p)
        if rest is None:
            return {}
        stiffness = _slope(_force(self.osc, p), rest)
        slopes = {}
        for name in self.osc.law.parameters:
            slope = _slope(lambda v, name=name: _force(self.osc, {**p, name: v})(rest), float(p[name]))
            slopes[name] = -slope / stiffness
        return slopes


def _scales(osc: Oscillator, p: Mapping[str, float]) -> tuple[float, float, float]:
    """Return the equilibrium θ_e nearest to theta0, the amplitude about it, and the angular frequency ω there (rad/s).

    The amplitude is √((θ₀ − θ_e)² + (θ̇₀/ω)²). p: values of all parameters except those of the damping, by name. If
    there is no stable equilibrium in the range of the search, or the derivative of the force there is not positive,
    return theta0, |theta0| and 1. Raises Refusal if the restoring law has no `kernel`.
    """
    theta0, omega0 = float(p["theta0"]), float(p["omega0"])
    law, reach = np.array(_law_values(osc, p)), SEARCH_REACH * max(1.0, abs(theta0))
    try:
        rest = rest_near(by_kernel(osc.law.kernel, law), theta0, reach, SEARCH_POINTS)
    except NotImplementedError:
        raise Refusal(
            f"the restoring law {osc.restoring!r} has no `kernel`; define this method to compute trajectories"
        ) from None
    squared_frequency = 0.0 if rest is None else _slope(_force(osc, p), rest)
    if rest is None or not squared_frequency > 0.0:
        return theta0, abs(theta0), 1.0
    frequency = float(np.sqrt(squared_frequency))
    return rest, float(np.hypot(theta0 - rest, omega0 / frequency)), frequency


def _force(osc: Oscillator, p: Mapping[str, float]) -> Callable[[float], float]:
    """Return the restoring force as a function of the position only, with the values of the law's parameters in p."""
    law = _law_values(osc, p)
    return lambda x: osc.law.kernel(x, law)


def _slope(function: Callable[[float], float], x: float) -> float:
    """Return the derivative of a smooth scalar function at x, by a central difference."""
    h = FORCE_STEP * max(1.0, abs(x))
    return (function(x + h) - function(x - h)) / (2.0 * h)


def simulate(
    osc: Oscillator,
    p: Mapping[str, float],
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Return the trajectory of an oscillator that starts with theta0 and omega0 at the first time.

    Parameters
    ----------
    osc
        The oscillator.
    p
        Values of all its parameters, by name (`Oscillator.parameters`).
    times
        Times in s, shape (n,), not decreasing.
    quantity
        What to return: "angle", "velocity" or "acceleration".
    tolerance
        Largest error, in the unit of the quantity.

    Returns
    -------
    ndarray
        The quantity at these times, shape (n,); all NaN if the trajectory diverges, needs too many steps, or if a
        damping term needs the equilibrium and none is found.

    Raises
    ------
    ValueError
        If a parameter is missing or the quantity is unknown.
    Refusal
        If the restoring law or a damping term has no `kernel`.
    """
    missing = [name for name in osc.parameters if name not in p]
    if missing:
        raise ValueError(f"parameter {missing[0]!r} is missing; needed are {', '.join(osc.parameters)}")
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity {quantity!r} is not one of {', '.join(QUANTITIES)}")
    return Trajectories(osc, times, quantity, p, tolerance).record(p)
