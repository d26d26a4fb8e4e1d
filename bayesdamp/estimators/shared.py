"""What several estimators need of a record: its motion with derivatives, and starting values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.physics.damping import DampingTerm, median
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.oscillation.turning import midpoints, turning_points
from bayesdamp.records.reference import reference_of
from bayesdamp.types import Problem, Reference, Refusal, Signal

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 7
"""Degree of the splines: derivatives from an interpolating one are good to a millionth of a per cent."""
FEWEST = 4
"""Samples before a gap from which a start is read."""
WHOLE, PARTS = 32_768, 8
"""Samples up to which all say how large the noise is, and beyond them in how many parts as many do."""
NO_NOISE = 1e-6
"""Noise below this share of the amplitude is none: a likelihood has nothing to weigh by."""
KNOTS_PER_PERIOD = 4.0
"""Knots of the smoothing spline: it keeps the oscillation and its second harmonic."""
EDGE = 1.5
"""Knot spacings left out at each end of a smoothing spline, where its derivatives are poor."""
LEAST_SAMPLES_PER_CYCLE = 6.0
ORDER = {"angle": 0, "velocity": 1, "acceleration": 2}


@dataclass(frozen=True)
class Motion:
    """Displacement, velocity and acceleration at m instants, all from one spline.

    t (m,) in s; theta, omega, alpha (m,) in rad, rad/s, rad/s² (or m).
    clean: whether the spline interpolates; else it smooths, and `project` does to a function of the motion
    what the smoothing did to the record, so that an equation that holds for the motion holds for both sides
    projected. project takes values at all samples (n,) to values at t (m,).
    everywhere: theta, omega, alpha at all samples that are used, each (n,).
    bandwidth: the highest angular frequency that the spline follows, rad/s.
    noise: sd of the record's noise as far as a spline of four samples a knot sees it, unit of the record.
    theta0, omega0: displacement and velocity at the record's start.
    integrated: how often the record was integrated to get the displacement with constants that are not known.
    response: noise of shape (n, m) on the samples of a displacement to what the spline makes of it: displacement,
    velocity and acceleration at all samples, each (n, m); None where the record was integrated.
    """

    t: np.ndarray
    theta: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    clean: bool
    project: Callable[[np.ndarray], np.ndarray]
    everywhere: tuple[np.ndarray, np.ndarray, np.ndarray]
    bandwidth: float
    noise: float
    theta0: float
    omega0: float
    integrated: int
    response: Callable[[np.ndarray], tuple[np.ndarray, ...]] | None


def oscillator(problem: Problem) -> Oscillator:
    """The oscillator that a problem speaks of."""
    return Oscillator(damping=tuple(problem.damping), restoring=problem.system.restoring)


def known_restoring(problem: Problem) -> dict[str, float]:
    """The restoring parameters that are known."""
    known = problem.system.known
    return {name: float(known[name]) for name in oscillator(problem).law.parameters if name in known}


def free_names(problem: Problem) -> list[str]:
    """What is to be found besides the damping: restoring parameters, theta0, omega0, as far as not known."""
    names = (*oscillator(problem).law.parameters, "theta0", "omega0")
    return [name for name in names if name not in problem.system.known]


def free_start(problem: Problem, theta0: float, omega0: float) -> dict[str, float]:
    """Displacement and velocity at the start, as far as not known."""
    start = {"theta0": float(theta0), "omega0": float(omega0)}
    return {name: value for name, value in start.items() if name not in problem.system.known}


def epsilon_of(problem: Problem, seen: Features) -> float:
    """The width of friction's switch, rad/s: as known, else 2 % of the record's peak velocity."""
    known = problem.system.known.get("epsilon")
    return float(known) if known is not None else Reference(seen.amplitude, seen.frequency).friction_width


def beside_coefficients(problem: Problem, seen: Features) -> dict[str, float]:
    """What the damping terms take beside their coefficients: ε where one switches, their further parameters (as known,
    else the medians of their priors), and the record's scales."""
    osc, reference = oscillator(problem), reference_of(problem.system, seen)
    epsilon = {"epsilon": epsilon_of(problem, seen)} if osc.switches else {}
    scales = reference.scales(seen.rest)
    medians = {
        p.name: median(p.prior(reference.amplitude, reference.frequency))
        for t in osc.terms
        for p in t.inferred
    }
    known = {n: float(v) for n, v in problem.system.known.items() if n in medians}
    return {**epsilon, **{n: scales[n] for n in osc.scales}, **medians, **known}


def further_priors(problem: Problem, seen: Features) -> dict[str, Prior]:
    """Priors of the damping terms' parameters beside their coefficients, those that are not known."""
    reference = reference_of(problem.system, seen)
    every = {p.name: p for t in oscillator(problem).terms for p in t.inferred}
    return {
        n: p.prior(reference.amplitude, reference.frequency)
        for n, p in every.items()
        if n not in problem.system.known
    }


def start_parameters(signal: Signal, problem: Problem, seen: Features) -> dict[str, float]:
    """Every parameter of a trajectory but the damping: as known, else read off the record.

    Restoring parameters come from its frequency and midline, theta0 and omega0 from the smoothed record.
    """
    osc, known = oscillator(problem), problem.system.known
    p = dict(osc.law.start(seen.frequency, seen.rest, known_restoring(problem)))
    p |= beside_coefficients(problem, seen)
    if "theta0" not in known or "omega0" not in known:
        seen_motion = motion(signal, problem, seen)
        p |= {"theta0": seen_motion.theta0, "omega0": seen_motion.omega0}
    return p | {name: float(known[name]) for name in ("theta0", "omega0") if name in known}


def decay_start(problem: Problem, seen: Features) -> dict[str, float]:
    """Damping coefficients from the energy that the record loses from one turning point to the next.

    The logarithmic decrement at amplitude A is π times the sum of the terms' equivalent damping ratios at A;
    solved by non-negative least squares, each swing weighted by its amplitude. Rough, but never far off.
    """
    from scipy.optimize import nnls

    osc = oscillator(problem)
    # Half the distance of neighbouring turning points needs no midline.
    sizes = np.abs(np.diff(seen.turning_values)) / 2
    times = (seen.turning_times[1:] + seen.turning_times[:-1]) / 2
    largest = max(float(sizes.max()), 1e-300)
    sizes = sizes * (seen.amplitude / largest)
    good = sizes > 3 * seen.roughness * seen.amplitude / largest
    sizes, times = sizes[good], times[good]
    if sizes.size < 2:
        return {
            term.parameter: 0.01 / term.ratio_per_unit(seen.amplitude, seen.frequency) for term in osc.terms
        }
    middle = np.sqrt(sizes[1:] * sizes[:-1])
    rate = -np.diff(np.log(sizes)) / (seen.frequency * np.diff(times))
    beside = beside_coefficients(problem, seen)
    columns = np.column_stack(
        [[_ratio(term, float(a), seen.frequency, beside) for a in middle] for term in osc.terms]
    )
    scale = columns.max(axis=0)
    found = nnls(columns / scale * middle[:, None], rate * middle)[0] / scale
    return {term.parameter: float(value) for term, value in zip(osc.terms, found)}


def _ratio(term: DampingTerm, amplitude: float, frequency: float, beside: Mapping[str, float]) -> float:
    """The equivalent damping ratio of a motion (rad, rad/s) per unit of a term's coefficient."""
    if not term.further:
        return term.ratio_per_unit(amplitude, frequency)
    further = {n: beside[n] for n in term.further if n != "rest"}
    return term.work(amplitude, frequency, further) / (2 * np.pi * (frequency * amplitude) ** 2)


def solved(a: np.ndarray, b: np.ndarray, rcond: float | None = None) -> np.ndarray:
    """Return the least squares solution of a x = b, (c,), with the columns of a (n, c) scaled to one length.

    rcond: the share of the largest singular value below which a direction is left out.
    """
    scale = np.maximum(np.linalg.norm(a, axis=0), 1e-300)
    return np.linalg.lstsq(a / scale, b, rcond=rcond)[0] / scale


def checked_features(signal: Signal) -> Features:
    """The record's features. Raises Refusal where it has no oscillation or too few samples in one."""
    seen = features(signal)
    if seen.samples_per_cycle < LEAST_SAMPLES_PER_CYCLE:
        raise Refusal(
            f"{seen.samples_per_cycle:.1f} samples in a period, and at least "
            f"{LEAST_SAMPLES_PER_CYCLE:.0f} are needed"
        )
    return seen


def has_noise(signal: Signal, seen: Features) -> bool:
    """Return whether a record with these features has noise that a likelihood can weigh by."""
    return noise_level(signal) > NO_NOISE * float(np.abs(seen.turning_amplitudes).max())


def noise_level(signal: Signal) -> float:
    """Standard deviation of the noise, unit of the record; rounding error where there is none.

    From what a spline of degree 7 with a knot at every fourth sample leaves over (median absolute value, so
    that the corners of Coulomb friction do not count), in parts of the record where samples are very many; quantisation
    counts as step/√12.
    """
    t, y = signal.t, signal.y
    if t.size < 40:
        return max(float(np.std(np.diff(y, 6))) / np.sqrt(924.0), signal.step / np.sqrt(12.0))
    left = []
    for part in _spread(t.size):
        spline = _least_squares(t[part], y[part], t[part][4:-4:4])
        freedom = 1.0 - (spline.c.size / t[part].size)
        left.append(np.abs(y[part] - spline(t[part])) / np.sqrt(freedom))
    return max(1.4826 * float(np.median(np.concatenate(left))), signal.step / np.sqrt(12.0))


def _spread(n: int) -> list[slice]:
    """Of n samples all, or parts that are spread over very many: a spline of so many knots takes their square, and a
    median needs no more."""
    if n <= WHOLE:
        return [slice(0, n)]
    size = WHOLE // PARTS
    return [slice(first, first + size) for first in np.linspace(0, n - size, PARTS, dtype=int)]


def motion(
    signal: Signal, problem: Problem, seen: Features, knots_per_period: float = KNOTS_PER_PERIOD
) -> Motion:
    """Displacement, velocity and acceleration from the record alone, on a uniform clock or not.

    Where the noise of an interpolating spline's highest derivative, about 6σ/Δt² for an angle, is below a
    thousandth of the record's own, the spline of degree 7 interpolates and twenty samples at each end are
    left out. Otherwise a spline of degree 7 with `knots_per_period` is fitted to the record by least squares
    (samples further off than six robust standard deviations do not count) and one and a half knot
    spacings at each end are left out.
    A recorded velocity or acceleration is integrated; constants come from a known theta0 and omega0, else
    from the midline of the turning points. Runs between gaps are treated each by itself; of a velocity or an
    acceleration, which cannot be integrated across a gap, only the first counts.
    """
    noise = noise_level(signal)
    pieces = [replace(signal, t=signal.t[run], y=signal.y[run]) for run in runs(signal.t, seen.period)]
    parts = [
        _run(piece, problem, seen, noise, knots_per_period)
        for piece in (pieces if signal.quantity == "angle" else pieces[:1])
    ]
    if len(parts) == 1:
        return parts[0]
    ends = np.cumsum([part.everywhere[0].size for part in parts])[:-1]

    def project(x: np.ndarray) -> np.ndarray:
        return np.concatenate([part.project(piece) for part, piece in zip(parts, np.split(x, ends))])

    def response(x: np.ndarray) -> tuple[np.ndarray, ...]:
        found = [
            part.response(piece) for part, piece in zip(parts, np.split(x, ends)) if part.response is not None
        ]
        return tuple(np.concatenate(pieces) for pieces in zip(*found))

    def joined(of: Callable[[Motion], np.ndarray]) -> np.ndarray:
        return np.concatenate([of(part) for part in parts])

    return replace(
        parts[0],
        t=joined(lambda part: part.t),
        theta=joined(lambda part: part.theta),
        omega=joined(lambda part: part.omega),
        alpha=joined(lambda part: part.alpha),
        project=project,
        everywhere=tuple(joined(lambda part, i=i: part.everywhere[i]) for i in range(3)),
        response=response if signal.quantity == "angle" else None,
    )


def runs(t: np.ndarray, period: float) -> list[slice]:
    """The runs of samples of times t (n,) between gaps, those of at least a period and the first.

    A gap is longer than three sampling intervals and a tenth of the period (s).
    """
    steps = np.diff(t)
    breaks = np.flatnonzero(steps > max(3 * float(np.median(steps)), 0.1 * period)) + 1
    bounds = [0, *breaks.tolist(), t.size]
    found = [slice(a, b) for a, b in pairwise(bounds)]
    return [run for i, run in enumerate(found) if i == 0 or t[run][-1] - t[run][0] >= period]


def _run(signal: Signal, problem: Problem, seen: Features, noise: float, knots_per_period: float) -> Motion:
    """The motion over a run of samples without a gap."""
    from scipy.interpolate import make_interp_spline

    t, y = signal.t, signal.y
    if t.size < FEWEST:
        raise Refusal("the samples before the first gap are too few; let the record begin after it")
    gap = (t[-1] - t[0]) / (t.size - 1)
    order = ORDER[signal.quantity]
    size = float(np.abs(seen.turning_amplitudes).max())
    highest = 2 - order
    amplified = noise * (2.5 / gap) ** highest / seen.frequency**highest
    clean = amplified < 1e-3 * size and t.size >= 4 * DEGREE
    if clean:
        spline = make_interp_spline(t, y, k=DEGREE)
        edge = min(20, t.size // 10)
        rows = np.arange(edge, t.size - edge)
        bandwidth = np.pi / gap
        project: Callable[[np.ndarray], np.ndarray] = lambda x: x[rows]  # noqa: E731
        through: Callable[[np.ndarray], BSpline] = lambda x: make_interp_spline(t, x, k=DEGREE)  # noqa: E731
    else:
        spacing = max(seen.period / knots_per_period, 2.2 * gap)
        knots = _knots(t, spacing)
        good = np.ones(t.size, dtype=bool)
        spline = _least_squares(t, y, knots)
        for _ in range(2):
            left = np.abs(y - spline(t))
            good = left <= 6 * 1.4826 * max(float(np.median(left)), 1e-300)
            knots = _knots(t[good], spacing)
            spline = _least_squares(t[good], y[good], knots)
        inside = np.flatnonzero((t >= t[0] + EDGE * spacing) & (t <= t[-1] - EDGE * spacing))
        rows = inside[:: max(1, int(spacing / (16 * gap)))]
        bandwidth = np.pi / spacing
        through = lambda x: _least_squares(t, x, knots)  # noqa: E731
        project = lambda x: through(x)(t[rows])  # noqa: E731
    curves, unknown = integrated(spline, signal, problem, seen)
    everywhere = tuple(curve(t) for curve in curves)
    return Motion(
        t[rows],
        *(values[rows] for values in everywhere),
        clean=bool(clean),
        project=project,
        everywhere=everywhere,  # type: ignore[arg-type]
        bandwidth=float(bandwidth),
        noise=noise,
        theta0=float(curves[0](t[:1])[0]),
        omega0=float(curves[1](t[:1])[0]),
        integrated=unknown,
        response=None if order else lambda x: tuple(through(x)(t, j) for j in range(3)),
    )


def _knots(t: np.ndarray, spacing: float) -> np.ndarray:
    """Inner knots about `spacing` apart with at least two samples between neighbours."""
    wanted = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / spacing) + 1))[1:-1]
    at = np.searchsorted(t, wanted)
    kept, last = [], 0
    for knot, i in zip(wanted, at):
        if i - last >= 2 and t.size - i >= 2:
            kept.append(knot)
            last = i
    return np.asarray(kept)


def _least_squares(t: np.ndarray, y: np.ndarray, inner: np.ndarray) -> BSpline:
    from scipy.interpolate import make_lsq_spline

    for degree in range(DEGREE, 0, -2):  # a few samples before a gap bear a lower one
        knots = np.r_[(t[0],) * (degree + 1), inner, (t[-1],) * (degree + 1)]
        try:
            return make_lsq_spline(t, y, knots, k=degree)
        except (ValueError, np.linalg.LinAlgError):
            continue
    raise Refusal("the samples are too few or too unevenly spaced for a smoothing spline")


Curve = Callable[[np.ndarray], np.ndarray]


def integrated(
    spline: BSpline, signal: Signal, problem: Problem, seen: Features
) -> tuple[tuple[Curve, Curve, Curve], int]:
    """Displacement, velocity, acceleration as functions of time, and how many constants were guessed."""
    known, t, order = problem.system.known, signal.t, ORDER[signal.quantity]
    if order == 0:
        return (spline, spline.derivative(1), spline.derivative(2)), 0
    guessed = 0
    below = spline if order == 1 else spline.antiderivative(1)
    shift = np.zeros(1)
    if order == 2:
        if "omega0" in known:
            shift = np.array([known["omega0"] - float(below(t[0]))])
        else:
            shift, guessed = -_midline(t, below(t), seen.period, 0), 1
    velocity: Curve = lambda x: below(x) + shift[0]  # noqa: E731
    lowest = below.antiderivative(1)
    raw: Curve = lambda x: lowest(x) + shift[0] * (x - t[0])  # noqa: E731
    if "theta0" in known and not guessed:
        line = np.array([known["theta0"] - float(raw(t[:1])[0]), 0.0])
    else:
        guessed += 1
        middle = _midline(t, raw(t), seen.period, guessed - 1)
        line = np.r_[_rest(problem, seen), 0.0] - np.r_[middle, 0.0][:2]
    angle: Curve = lambda x: raw(x) + line[0] + line[1] * (x - t[0])  # noqa: E731
    return (angle, velocity, spline.derivative(1) if order == 1 else spline), guessed


def _midline(t: np.ndarray, y: np.ndarray, period: float, degree: int) -> np.ndarray:
    """Coefficients, lowest first, of a polynomial in t − t[0] through the midline of the turning points."""
    turns = turning_points(t, y, period)
    if turns.times.size < 4:
        return np.r_[float(np.mean(y)), np.zeros(degree)]
    return np.polynomial.polynomial.polyfit(turns.times - t[0], midpoints(turns.values), degree)


def _rest(problem: Problem, seen: Features) -> float:
    """The equilibrium of the restoring law, as far as it is known, the rest from the record's frequency."""
    osc = oscillator(problem)
    try:
        return osc.equilibrium(osc.law.start(seen.frequency, seen.rest, known_restoring(problem)))
    except ValueError:
        return 0.0
