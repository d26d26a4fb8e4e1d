"""Define the base class of estimators, and functions that several of them use.

The functions compute the motion and its derivatives from a record with a spline, measure the noise, choose starting
values of parameters, and import optional packages.
"""

from __future__ import annotations

import importlib
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np
import scipy  # loads its modules when they are used
from numpy.polynomial import Polynomial
from pydantic import BaseModel, ConfigDict

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator, reference_of
from bayesdamp.plugins import Plugin
from bayesdamp.records.oscillation.features import (
    Features,
    features as measure,
    midpoints,
    once_per_record,
    turning_points,
)
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Reference, Refusal, Signal

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


DEGREE = 7
"""Degree of the splines. The derivatives of an interpolating spline of this degree have relative errors near 1e-8."""
LEAST_SAMPLES = 4
"""Least number of samples before the first interruption of the sampling (`before_gap`). A record with fewer is refused,
because the start of the motion is determined from these samples."""
NOISE_SAMPLES, NOISE_PARTS = 8_192, 8
"""The noise is measured from at most `NOISE_SAMPLES` samples. In a longer record these samples are in `NOISE_PARTS`
parts of equal length, spread evenly over the record."""
NO_NOISE = 1e-6
"""A record with at most this noise (standard deviation, as a fraction of its amplitude) counts as noise-free: a
likelihood, which needs noise, cannot be computed for it."""
KNOTS_PER_PERIOD = 4.0
"""Number of knots of the smoothing spline in a period of the oscillation; with it the spline preserves the oscillation
and its second harmonic."""
EDGE = 1.5
"""At each end of a noisy record, the smoothed motion is not used over this length (in knot spacings), because the
derivatives of the smoothing spline are inaccurate there."""
LEAST_SAMPLES_PER_CYCLE = 6.0
"""Least number of samples in a period (conventional). A record with fewer is refused."""
MEANS_PER_CYCLE = 40.0
"""Least number of blocks in a cycle when a record is thinned by averaging blocks of samples. The averaging then reduces
the amplitude of a sinusoid by at most 0.1 %."""
Curve = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class SmoothedMotion:
    """Displacement, velocity and acceleration from one spline.

    It covers the n samples before the first interruption of the sampling (`before_gap`). t (m,): times in s of m
    selected samples, which are not near the ends. theta, omega, alpha (m,): displacement, velocity and acceleration at
    t, in rad, rad/s and rad/s² (or m for rad). clean: true if the spline interpolates the record, which is then nearly
    free of noise; false if it smooths it. project: function that smooths any function of the motion in the same way as
    the record; it maps values at all n samples (n,) to smoothed values at t (m,). A linear relation, such as the
    equation of motion, still holds after all its parts were smoothed so. everywhere: theta, omega, alpha at all n
    samples, each (n,). bandwidth: the highest angular frequency that the spline follows, in rad/s. theta0, omega0:
    displacement and velocity of the spline at the first sample, even if others are known. integrated: number of
    constants of integration that were guessed, 0 to 2; 0 for a recorded angle.
    """

    t: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    clean: bool
    project: Curve
    everywhere: tuple[np.ndarray, np.ndarray, np.ndarray]
    bandwidth: float
    theta0: float
    omega0: float
    integrated: int


def oscillator(problem: Problem) -> Oscillator:
    """Return the oscillator of a problem, with its damping terms and its restoring law."""
    return Oscillator(damping=tuple(problem.damping), restoring=problem.system.restoring)


def ratios_per_unit(problem: Problem, features: Features) -> np.ndarray:
    """Return the equivalent viscous damping ratio of each of k damping terms with the coefficient 1, (k,).

    Each is the ratio for a harmonic motion with the amplitude at the record's first sample and the record's mean
    frequency. It converts between a coefficient and a damping ratio.
    """
    amplitude, frequency = features.amplitude, features.frequency
    return np.array([t.ratio_per_unit(amplitude, frequency) for t in oscillator(problem).terms])


def known_restoring(problem: Problem) -> dict[str, float]:
    """Return the values of the restoring parameters that are known, by name."""
    known = problem.system.known
    return {name: float(known[name]) for name in oscillator(problem).law.parameters if name in known}


def free_names(problem: Problem) -> list[str]:
    """Return the names of the unknown parameters that are not damping.

    They are, in this order, those of the restoring law, and displacement (theta0) and velocity (omega0) at the start,
    as far as the problem does not state them as known.
    """
    names = (*oscillator(problem).law.parameters, "theta0", "omega0")
    return [name for name in names if name not in problem.system.known]


def free_start(problem: Problem, theta0: float, omega0: float) -> dict[str, float]:
    """Return those of the start values theta0 (displacement) and omega0 (velocity) that are not known, by name.

    A method reports the result as its estimate of the unknown start.
    """
    start = {"theta0": float(theta0), "omega0": float(omega0)}
    return {name: value for name, value in start.items() if name not in problem.system.known}


def epsilon_of(problem: Problem, features: Features) -> float:
    """Return the width ε (rad/s or m/s) within which dry friction changes its sign with the velocity.

    It is the known value (0 for friction that jumps), or else 2 % of the record's peak velocity.
    """
    known = problem.system.known.get("epsilon")
    if known is not None:
        return float(known)
    return Reference(features.amplitude, features.frequency).friction_width


def further_values(problem: Problem, features: Features) -> dict[str, float]:
    """Return the numbers on which the damping forces depend besides their coefficients and the motion, by name.

    These are `epsilon`, the width ε within which dry friction changes its sign, if a term depends on it; and those of
    `rest`, `reference_velocity` and `reference_amplitude` that a term needs. `rest` is the record's midline. The two
    scales follow from `reference_of`, which prefers specified values to measured ones, and raises InputError if no
    oscillation is possible with the known restoring parameters.
    """
    osc, scales = oscillator(problem), reference_of(problem.system, features).scales(features.rest)
    epsilon = {"epsilon": epsilon_of(problem, features)} if osc.switches else {}
    return {**epsilon, **{n: scales[n] for n in osc.scales}}


def start_parameters(signal: Signal, problem: Problem, features: Features) -> dict[str, float]:
    """Return all parameters of a trajectory except the damping coefficients: known values, or values from the record.

    They are returned by name and include those of `further_values`. Unknown restoring parameters follow from the
    record's frequency and midline, unknown theta0 and omega0 (displacement and velocity at the start) from the spline
    of `motion`. Raises InputError or Refusal if one of these two functions does.
    """
    osc, known = oscillator(problem), problem.system.known
    p = dict(osc.law.start(features.frequency, features.rest, known_restoring(problem)))
    p |= further_values(problem, features)
    if "theta0" not in known or "omega0" not in known:
        smoothed = motion(signal, problem, features)
        p |= {"theta0": smoothed.theta0, "omega0": smoothed.omega0}
    return p | {name: float(known[name]) for name in ("theta0", "omega0") if name in known}


def rest_position(signal: Signal, problem: Problem, features: Features) -> float:
    """Return the position about which the motion oscillates, in rad or m.

    It is the midline of a record of displacements. A velocity or acceleration does not show it: then it is the stable
    equilibrium nearest to 0 of the restoring law, whose unknown parameters are guessed (`RestoringLaw.start`), or 0 if
    there is none.
    """
    if DERIVATIVES[signal.quantity] == 0:
        return features.rest
    osc = oscillator(problem)
    try:
        return osc.equilibrium(osc.law.start(features.frequency, features.rest, known_restoring(problem)))
    except ValueError:
        return 0.0


def decay_start(problem: Problem, features: Features) -> dict[str, float]:
    """Estimate damping coefficients from the energy that the record loses between turning points.

    The logarithmic decrement in half a cycle at amplitude A is π times the sum of the terms' equivalent damping ratios
    at A. The coefficients follow by non-negative least squares, in which each half cycle is weighted by its amplitude;
    they can be 0. The result, by name, is a rough but robust start for fits. If fewer than two half cycles have an
    amplitude above three times the noise, each coefficient is instead that of a damping ratio of 0.01.
    """
    osc = oscillator(problem)
    # The amplitude of a half cycle is half the distance of its turning points: no midline is needed.
    sizes = np.abs(np.diff(features.turning_values)) / 2
    times = (features.turning_times[1:] + features.turning_times[:-1]) / 2
    largest = max(float(sizes.max()), 1e-300)
    sizes = sizes * (features.amplitude / largest)
    good = sizes > 3 * features.roughness * features.amplitude / largest
    sizes, times = sizes[good], times[good]
    w = features.frequency
    if sizes.size < 2:
        return dict(zip(osc.coefficients, (0.01 / ratios_per_unit(problem, features)).tolist()))
    middle = np.sqrt(sizes[1:] * sizes[:-1])
    rate = -np.diff(np.log(sizes)) / (w * np.diff(times))
    arguments = further_values(problem, features)
    ratios = []  # for each term: the equivalent damping ratio per unit coefficient at each amplitude
    for term in osc.terms:
        if term.further:
            further = {n: arguments[n] for n in term.further if n != "rest"}
            ratios.append([term.work(a, w, further) / (2 * np.pi * (w * a) ** 2) for a in middle.tolist()])
        else:
            ratios.append([term.ratio_per_unit(a, w) for a in middle.tolist()])
    columns = np.column_stack(ratios)
    scale = columns.max(axis=0)
    coefficients = scipy.optimize.nnls(columns / scale * middle[:, None], rate * middle)[0] / scale
    return dict(zip(osc.coefficients, map(float, coefficients)))


def solve(a: np.ndarray, b: np.ndarray, rcond: float | None = None) -> np.ndarray:
    """Return the least squares solution x (c,) of a x = b, where a is (n, c) and b (n,).

    The columns of a are scaled to unit length for the solution, and x is scaled back. rcond: the fraction of the
    largest singular value below which singular values count as zero; by default about the rounding error.
    """
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    return np.linalg.lstsq(a / scale, b, rcond=rcond)[0] / scale


def checked_features(signal: Signal) -> Features:
    """Measure the features of a record (such as period and amplitude), and check that estimators can use the record.

    Raises
    ------
    Refusal
        If the record has fewer than ten samples or no oscillation, or fewer than `LEAST_SAMPLES_PER_CYCLE` samples in a
        period.
    """
    features = measure(signal)
    if features.samples_per_cycle < LEAST_SAMPLES_PER_CYCLE:
        raise Refusal(
            f"the record has {features.samples_per_cycle:.1f} samples in a period; at least "
            f"{LEAST_SAMPLES_PER_CYCLE:.0f} are needed"
        )
    return features


def has_noise(signal: Signal, features: Features) -> bool:
    """Return whether a record has enough noise for a likelihood: more than `NO_NOISE` times its largest amplitude."""
    return noise_level(signal) > NO_NOISE * float(np.abs(features.turning_amplitudes).max())


@once_per_record
def noise_level(signal: Signal) -> float:
    """Return the standard deviation of the noise in the record's unit; the rounding error if there is no noise.

    It is computed from the median absolute residual of a spline of degree 7 with a knot at every fourth sample, for a
    long record in parts of it (`NOISE_PARTS`). The median is not affected by the sudden changes that Coulomb friction
    causes. With fewer than 40 samples, it is computed from sixth differences of the samples. It is at least
    `signal.step`/√12, the noise of quantisation.
    """
    t, y = signal.t, signal.y
    if t.size < 40:
        return max(float(np.std(np.diff(y, 6))) / np.sqrt(924.0), signal.step / np.sqrt(12.0))
    parts = [slice(0, t.size)]
    if t.size > NOISE_SAMPLES:  # the time to fit a spline grows with the square of its knots
        size = NOISE_SAMPLES // NOISE_PARTS
        begins = np.linspace(0, t.size - size, NOISE_PARTS, dtype=int)
        parts = [slice(begin, begin + size) for begin in begins]
    left = []
    for part in parts:
        spline = _fit_spline(t[part], y[part], t[part][4:-4:4])
        left.append(np.abs(y[part] - spline(t[part])) / np.sqrt(1.0 - spline.c.size / t[part].size))
    return max(1.4826 * float(np.median(np.concatenate(left))), signal.step / np.sqrt(12.0))


def thin_record(signal: Signal, features: Features, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Return times and samples (t, y) of a record, thinned to at most `most` samples.

    A longer record with noise above 1e-5 of its amplitude is averaged: each block of successive samples, at most
    1/`MEANS_PER_CYCLE` of a cycle long, becomes its mean time and mean value. Blocks that contain an interruption of
    the sampling are left out. If more than `most` values remain, or the record has less noise, evenly spread values are
    selected. Times are in s, samples in the unit of the record, (m,) each.
    """
    t, y = signal.t, signal.y
    size = float(np.abs(features.turning_amplitudes).max())
    if t.size > most and noise_level(signal) > 1e-5 * size:
        group = min(-(-t.size // most), max(1, int(features.samples_per_cycle / MEANS_PER_CYCLE)))
        blocks = t.size // group
        times = t[: blocks * group].reshape(blocks, group)
        whole = times[:, -1] - times[:, 0] <= 1.5 * (group - 1) * float(np.median(np.diff(t)))
        t, y = times.mean(axis=1)[whole], y[: blocks * group].reshape(blocks, group).mean(axis=1)[whole]
    rows = np.unique(np.linspace(0, t.size - 1, min(most, t.size)).round().astype(int))
    return t[rows], y[rows]


def phase_of(signal: Signal, features: Features) -> Polynomial:
    """Return the phase of a record in rad, a polynomial in time (s).

    The phase is about 0 at the first turning point in `features`, and grows by about π from each of them to the next.
    If there are at least 9 turning points, and they cover more than 0.75 of the record, the polynomial has degree 3, to
    follow a frequency that changes with the amplitude. Otherwise it is a straight line. The estimators `pinn` and `rnn`
    use it.
    """
    turns = features.turning_times
    if turns.size >= 9 and turns[-1] - turns[0] > 0.75 * (signal.t[-1] - signal.t[0]):
        return Polynomial.fit(turns, np.pi * np.arange(turns.size), 3, w=features.turning_amplitudes)
    return Polynomial([-features.frequency * turns[0], features.frequency])


def motion(
    signal: Signal, problem: Problem, features: Features, knots_per_period: float = KNOTS_PER_PERIOD
) -> SmoothedMotion:
    """Compute displacement, velocity and acceleration from a record, whose times may be uneven.

    Only the part of the record before its first interruption of the sampling is used (`before_gap`). If it has at least
    28 samples and negligible noise, a spline of degree 7 interpolates it: the noise in the acceleration of this spline
    (about 6σ/Δt² for an angle with noise σ and sampling interval Δt) must be below a thousandth of the acceleration.
    Otherwise a spline of degree 7 with `knots_per_period` knots in a period (fewer if the samples are few) is fitted by
    least squares, without samples that deviate from it by more than six robust standard deviations. The selected times
    of the result (`t`) are not near the ends of the record, where the spline is inaccurate; after a fit, at most 32 in
    a knot spacing are selected. A recorded velocity or acceleration is integrated (`integrate`). Raises Refusal if
    there are too few samples.
    """
    noise, signal = noise_level(signal), before_gap(signal, features.period)
    t, y = signal.t, signal.y
    gap = (t[-1] - t[0]) / (t.size - 1)
    size = float(np.abs(features.turning_amplitudes).max())
    highest = 2 - DERIVATIVES[signal.quantity]
    amplified = noise * (2.5 / gap) ** highest / features.frequency**highest
    clean = bool(amplified < 1e-3 * size and t.size >= 4 * DEGREE)
    knots = np.zeros(0)
    if clean:
        edge = min(20, t.size // 10)
        rows = np.arange(edge, t.size - edge)
        bandwidth = np.pi / gap
        spline = scipy.interpolate.make_interp_spline(t, y, k=DEGREE)
    else:
        spacing = max(features.period / knots_per_period, 2.2 * gap)
        knots = _knots(t, spacing)
        spline = _fit_spline(t, y, knots)
        for _ in range(2):
            left = np.abs(y - spline(t))
            good = left <= 6 * 1.4826 * max(float(np.median(left)), 1e-300)
            knots = _knots(t[good], spacing)
            spline = _fit_spline(t[good], y[good], knots)
        inside = np.flatnonzero((t >= t[0] + EDGE * spacing) & (t <= t[-1] - EDGE * spacing))
        rows = inside[:: max(1, int(spacing / (16 * gap)))]
        bandwidth = np.pi / spacing

    def smooth(x: np.ndarray) -> BSpline:
        return scipy.interpolate.make_interp_spline(t, x, k=DEGREE) if clean else _fit_spline(t, x, knots)

    curves, guessed = integrate(spline, signal, problem, features)
    theta, omega, alpha = (curve(t) for curve in curves)
    return SmoothedMotion(
        t[rows],
        theta[rows],
        omega[rows],
        alpha[rows],
        clean=clean,
        project=lambda x: x[rows] if clean else smooth(x)(t[rows]),
        everywhere=(theta, omega, alpha),
        bandwidth=float(bandwidth),
        theta0=float(curves[0](t[:1])[0]),
        omega0=float(curves[1](t[:1])[0]),
        integrated=guessed,
    )


def before_gap(signal: Signal, period: float) -> Signal:
    """Return the part of a record before its first interruption of the sampling, or the whole record if it has none.

    An interruption is an interval between samples that is longer than three median intervals, and longer than a tenth
    of the period (s). Raises Refusal if the part has fewer than `LEAST_SAMPLES` samples.
    """
    steps = np.diff(signal.t)
    gaps = np.flatnonzero(steps > max(3 * float(np.median(steps)), 0.1 * period))
    end = gaps[0] + 1 if gaps.size else signal.t.size
    if end < LEAST_SAMPLES:
        raise Refusal(
            f"the record has {end} samples before its first gap, and at least {LEAST_SAMPLES} are needed; choose a "
            "record that begins after the gap"
        )
    return replace(signal, t=signal.t[:end], y=signal.y[:end])


def _knots(t: np.ndarray, spacing: float) -> np.ndarray:
    """Return the inner knots of a spline, about `spacing` (s) apart, with at least two samples in each interval.

    t: times of the samples in s, (n,).
    """
    wanted = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / spacing) + 1))[1:-1]
    knots, last = [], 0
    for knot, i in zip(wanted, np.searchsorted(t, wanted)):
        if i - last >= 2 and t.size - i >= 2:
            knots.append(knot)
            last = i
    return np.asarray(knots)


def _fit_spline(t: np.ndarray, y: np.ndarray, inner: np.ndarray) -> BSpline:
    """Fit a spline of degree 7 (5, 3 or 1 if the samples are few) to y (n,) at times t (n,) by least squares.

    inner: the knots between the ends, in the unit of t. Raises Refusal if no degree allows a fit.
    """
    for degree in range(DEGREE, 0, -2):  # a few samples before a gap allow only a lower degree
        knots = np.r_[(t[0],) * (degree + 1), inner, (t[-1],) * (degree + 1)]
        try:
            return scipy.interpolate.make_lsq_spline(t, y, knots, k=degree)
        except (ValueError, np.linalg.LinAlgError):
            continue
    raise Refusal("the samples are too few or too unevenly spaced for a smoothing spline")


def integrate(
    spline: BSpline, signal: Signal, problem: Problem, features: Features
) -> tuple[tuple[Curve, Curve, Curve], int]:
    """Return the motion from the spline of a record: a velocity is integrated once, an acceleration twice.

    The constants of integration follow from a known start (theta0 and omega0). Otherwise they are guessed, so that the
    velocity oscillates about 0, and the displacement about `rest_position`. If omega0 is guessed, theta0 is guessed
    too, even if it is known. spline: spline of the samples in `signal`.

    Returns
    -------
    (displacement, velocity, acceleration), int
        The motion as functions of time in s (rad, rad/s and rad/s², or m), and the number of guessed constants.
    """
    known, t, order = problem.system.known, signal.t, DERIVATIVES[signal.quantity]
    if order == 0:
        return (spline, spline.derivative(1), spline.derivative(2)), 0
    guessed = 0
    below = spline if order == 1 else spline.antiderivative(1)
    shift = 0.0
    if order == 2:
        if "omega0" in known:
            shift = known["omega0"] - float(below(t[0]))
        else:
            shift, guessed = -_midline(t, below(t), features.period, 0)[0], 1
    lowest = below.antiderivative(1)

    def velocity(x: np.ndarray) -> np.ndarray:
        return below(x) + shift

    def raw(x: np.ndarray) -> np.ndarray:
        return lowest(x) + shift * (x - t[0])

    if "theta0" in known and not guessed:
        offset, slope = known["theta0"] - float(raw(t[:1])[0]), 0.0
    else:
        guessed += 1
        middle = np.r_[_midline(t, raw(t), features.period, guessed - 1), 0.0]
        offset, slope = rest_position(signal, problem, features) - middle[0], 0.0 - middle[1]

    def displacement(x: np.ndarray) -> np.ndarray:
        return raw(x) + offset + slope * (x - t[0])

    return (displacement, velocity, spline.derivative(1) if order == 1 else spline), guessed


def _midline(t: np.ndarray, y: np.ndarray, period: float, degree: int) -> np.ndarray:
    """Fit a polynomial in t − t[0] to the midline of a record y (n,); return its coefficients, the lowest first.

    The midline has the midpoints between turning points. If there are fewer than four turning points, the polynomial is
    the constant mean of y. t (n,), period: in s. degree: degree of the polynomial.
    """
    turns = turning_points(t, y, period)
    if turns.times.size < 4:
        return np.r_[float(np.mean(y)), np.zeros(degree)]
    return np.polynomial.polynomial.polyfit(turns.times - t[0], midpoints(turns.values), degree)


def optional_package(name: str) -> Any:
    """Import and return a package that only some estimators need.

    Raises
    ------
    Refusal
        If the package is not installed; the message says how to install it. If another package that it needs is
        missing, the ModuleNotFoundError is not caught.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # pysindy warns when it is imported
            return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        raise Refusal(
            f'this estimator needs {name}; install it with: pip install "bayesdamp[paper]"'
        ) from error


class Options(BaseModel):
    """Options of an estimator. Subclasses have a field with a default for each option.

    Unknown options, infinite values and NaN raise pydantic's ValidationError (`parse_options` converts it to
    InputError).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


OptionsType = TypeVar("OptionsType", bound=Options)


class Estimator(Plugin, ABC, Generic[OptionsType]):
    """A method that estimates damping coefficients from one record.

    name: name of the estimator; for those of this package the name of the file. options: class of its options.
    """

    options: type[OptionsType]
    by_position: str = ""
    """The reason, as a clause, why the method cannot estimate a damping force that depends on the position; "" if it
    can."""

    def refuses(self, damping: tuple[str, ...]) -> str | None:
        """Return the reason why this method cannot estimate a sum of damping terms, or None if it can (the default).

        A method with a restriction of its own overrides this. `reason_not_applicable` then checks two other
        restrictions: `by_position`, and terms that have parameters besides their coefficient. damping: names of the
        terms. The reason is text for a message, without a capital letter and a full stop.
        """
        return None

    @abstractmethod
    def initial(
        self, signal: Signal, problem: Problem, options: OptionsType, rng: np.random.Generator
    ) -> Estimate:
        """Estimate the unknown parameters from the record.

        Parameters
        ----------
        signal, problem
            The record; the damping terms to estimate, and the known parameters of the system.
        options
            Options of this estimator.
        rng
            The only source of random numbers for methods that need them.

        Returns
        -------
        Estimate
            Values of the damping coefficients and of the unknown restoring and start parameters, by name, in SI units;
            standard errors if the method gives any; and an outcome that is not OK if the values are doubtful.
            `estimators.run` adds the estimator's name, the stage and the duration.

        Raises
        ------
        Refusal
            If the method cannot be applied to the record. The message is a sentence.
        """


def reason_not_applicable(estimator: Estimator[Any], damping: tuple[str, ...]) -> str | None:
    """Return the reason why an estimator cannot estimate a sum of these damping terms, or None if it can.

    damping: names of the terms. The reason is text for a message, without a capital letter and a full stop.
    Raises InputError if a term is unknown.
    """
    if reason := estimator.refuses(damping):
        return reason
    for term in map(TERMS.get, damping):
        if term.placed and estimator.by_position:
            return (
                f"the method cannot estimate {term.name} damping, which depends on the position: "
                f"{estimator.by_position}"
            )
        if term.inferred:
            return (
                f"{term.name} damping has parameters besides its coefficient, which estimators do not estimate; use "
                "bd.fit or bayesdamp compare"
            )
    return None


def table(estimators: Sequence[Estimator[Any]], terms: Sequence[str]) -> list[tuple[str, list[str | None]]]:
    """Return a row for each estimator: its name, and for each damping term the reason why it cannot estimate this term.

    terms: names of damping terms, each of which is considered alone, not in a sum. A reason is a text as returned by
    `reason_not_applicable`, or None if the estimator can estimate the term.
    """
    return [(e.name, [reason_not_applicable(e, (term,)) for term in terms]) for e in estimators]
