"""Estimate damping by a genetic search for the simulated motion (trajectory) that fits a record best.

The method is that of section 3.11 of the paper that `bayesdamp.estimators` cites.
"""

from collections.abc import Mapping

import numpy as np
from pydantic import Field

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    checked_features,
    free_names,
    oscillator,
    start_parameters,
    thin_record,
)
from bayesdamp.physics.damping import DampingTerm
from bayesdamp.physics.oscillator import Trajectories
from bayesdamp.physics.restoring import RestoringLaw
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

TOLERANCE, OF_NOISE = 1e-5, 0.1
"""Largest error of a simulated trajectory: `TOLERANCE` times the amplitude or `OF_NOISE` times the standard deviation
of the noise, whichever is larger."""
GAIN = 1e-4
"""A search has converged when the mean misfit of the population `patience` generations ago exceeds the present least
misfit by at most this fraction. The misfit is the rms difference between trajectory and record."""
ALONE = 4.0
"""A damping coefficient is searched from 0 to this many times the value with which its term alone would cause the
record's decay."""
LEAST_READINGS = 200
"""A long record is thinned before it is compared with trajectories. The limit on its number of samples is never below
this number, even if the option `readings` asks for fewer."""
LEAST_DECAY = 0.05
"""If the amplitude of a record falls by less than this fraction, the search range of its damping is computed as if it
fell by this fraction, so that the range is not too narrow."""
PHASE = 3.0
"""Sets the range in which the angular frequency is searched. Its half width in rad/s is this phase (rad) divided by the
duration of the record (s), plus 0.5 % of the record's frequency."""
CHANGE = 1e-5
"""Relative step of the finite differences in Newton's method for harmonic balance (`_balance`)."""
PHASES, NEWTON = 24, 3
"""Settings of the harmonic balance (conventional). `PHASES`: number of points in a cycle at which the force is
averaged. `NEWTON`: number of steps of Newton's method."""


class GeneticOptions(Options):
    """Options of the genetic search: those of the paper that `bayesdamp.estimators` cites, and some others.

    population: number of trajectories in a generation for one unknown parameter, as in the paper; each further unknown
    adds half as many (forty trajectories for six unknowns become similar long before they are near the solution).
    tournament: number of randomly chosen trajectories of which the best becomes a parent. blend: α of the BLX-α
    crossover. mutation: standard deviation of the Gaussian mutation, as a fraction of the range that the population
    spans, which is the search range at first. mutated: probability with which a variable mutates. elite: fraction of
    the population that is kept unchanged (a tenth in the paper); at least one trajectory is. generations: largest
    number of generations. patience: the search has converged when the least misfit is at most the fraction `GAIN` below
    the mean misfit of the population this number of generations earlier. readings: largest number of
    samples of all trajectories of a generation together (but see `LEAST_READINGS`); a longer record is averaged over
    short blocks, or evenly spread samples are selected.
    """

    population: int = Field(default=40, ge=8, le=10_000)
    tournament: int = Field(default=3, ge=2)
    blend: float = Field(default=0.5, ge=0.0, le=2.0)
    mutation: float = Field(default=0.1, ge=0.0, le=1.0)
    mutated: float = Field(default=0.2, ge=0.0, le=1.0)
    elite: float = Field(default=0.1, ge=0.0, lt=1.0)
    generations: int = Field(default=200, ge=1)
    patience: int = Field(default=2, ge=2)
    readings: int = Field(default=250_000, ge=10_000)


class Genetic(Estimator[GeneticOptions]):
    """Search genetically for the unknown parameters whose trajectory has the least rms difference from the record.

    This difference is called the misfit. The unknown parameters are the damping coefficients, and those parameters of
    the restoring law and of the start (theta0, omega0) that are not known.
    """

    options = GeneticOptions

    def initial(
        self, signal: Signal, problem: Problem, options: GeneticOptions, rng: np.random.Generator
    ) -> Estimate:
        """Return the unknown parameters with the least misfit in the last generation, without standard errors.

        `details["course"]` has a list for each unknown parameter, by name: its value in the best trajectory of each
        generation. Raises Refusal if `checked_features` or `motion` does, or if all trajectories of the last generation
        diverge.
        """
        features = checked_features(signal)
        genes = Genes(signal, problem, features)
        unknowns = len(genes.names)
        size = round(options.population * (1 + (unknowns - 1) / 2))
        people = rng.random((size, unknowns))
        t, y = thin_record(signal, features, max(options.readings // size, LEAST_READINGS))
        amplitude = float(np.abs(features.turning_amplitudes).max())
        tolerance = max(TOLERANCE * amplitude, OF_NOISE * features.roughness)
        trajectories = Trajectories(genes.osc, t, signal.quantity, genes.base, tolerance)
        best, mean, leaders = [], [], []
        elite = min(max(1, round(options.elite * size)), size - 1)
        misfit, evaluations = np.zeros(0), 0
        while True:
            new = people[misfit.size :]
            left = trajectories.many(genes.decode(new)) - y
            evaluations += len(new)
            rms = np.sqrt(np.mean(left**2, axis=1))
            rms = np.where(np.isfinite(rms), rms, np.inf)  # a trajectory that diverges
            misfit = np.concatenate([misfit, rms])
            order = np.argsort(misfit, kind="stable")
            people, misfit = people[order], misfit[order]
            best.append(float(misfit[0]))
            mean.append(float(np.mean(misfit[np.isfinite(misfit)])) if np.isfinite(misfit[0]) else np.inf)
            leaders.append(people[0])
            are_equal = np.all(np.ptp(people, axis=0) <= 1e-9 * np.abs(people[0]))
            earlier = mean[-1 - options.patience] if len(best) > options.patience else np.inf
            has_converged = np.hypot(earlier, tolerance) <= (1 + GAIN) * np.hypot(best[-1], tolerance)
            if len(best) > options.generations or are_equal or has_converged:
                break
            people, misfit = _next_generation(people, genes, options, elite, rng), misfit[:elite]
        if not np.isfinite(best[-1]):
            raise Refusal("no simulated motion in the search range has finite values; check the known values")
        values = genes.decode(np.array(leaders))
        course = {name: values[name].tolist() for name in genes.names}
        final = {name: each[-1] for name, each in course.items()}
        return Estimate(self.name, "initial", final, details={"course": course}, evaluations=evaluations)


class Genes:
    """Convert the variables of the genetic search to the d unknown parameters of m trajectories.

    The variables u, (m, d), are scaled so that the search range is 0 ≤ u ≤ 1. For most parameters the variable is the
    scaled parameter. The exceptions are the stiffness and the angle (of rest, or of the relaxed spring) of a restoring
    law: their variables are the frequency and the midline of a motion at the record's middle amplitude, from which both
    parameters follow by harmonic balance. (If stiffness and gravity were searched themselves, most pairs would miss the
    record's frequency and so lose its phase, even if both values are nearly right.) names: names of the unknown
    parameters. low, high (d,): search range of each variable before scaling, in its unit (rad/s for the frequency).
    positive (d,): whether the variable must not be negative.
    """

    def __init__(self, signal: Signal, problem: Problem, features: Features) -> None:
        self.osc = oscillator(problem)
        self.base = start_parameters(signal, problem, features)
        self.names = (*self.osc.coefficients, *free_names(problem))
        self.size = float(np.sqrt(features.amplitude * min(features.final_amplitude, features.amplitude)))
        self.balanced = [
            name
            for name in self.osc.law.parameters
            if name in self.names and (name == "stiffness" or name.endswith("angle"))
        ]
        a, f, ranges = features.amplitude, features.frequency, []
        terms = dict(zip(self.osc.coefficients, self.osc.terms))
        for name in self.names:
            if name in terms:
                ranges.append((0.0, ALONE * coefficient_alone(terms[name], features)))
                continue
            centre, half = self.base[name], {"theta0": 0.2 * a, "omega0": 0.2 * a * f}.get(name)
            if name == "stiffness":
                centre, half = f, PHASE / (signal.t[-1] - signal.t[0]) + 0.005 * f
            elif half is None:
                half = {"rad": 0.1 * a, "1/(rad² s²)": f**2 / a**2}.get(self.osc.law.unit(name), f**2)
            if name in self.balanced and name != "stiffness":
                centre, half = features.rest, half if signal.quantity == "angle" else a
            ranges.append((centre - half, centre + half))
        self.low, self.high = np.array(ranges).T
        self.positive = np.arange(len(self.names)) < len(self.osc.terms)

    def decode(self, u: np.ndarray) -> dict[str, np.ndarray]:
        """Convert variables of the search, (m, d), to the values (m,) of every parameter of m trajectories, by name.

        Stiffness and angle are not finite where `_balance` does not give them.
        """
        x = dict(zip(self.names, (self.low + u * (self.high - self.low)).T))
        p = {name: np.full(u.shape[0], float(self.base.get(name, 0.0))) for name in self.osc.inputs}
        p |= {name: value for name, value in x.items() if name not in self.balanced}
        if self.balanced:
            law = {name: p[name] for name in self.osc.law.parameters}
            p |= _balance(self.osc.law, law, {name: x[name] for name in self.balanced}, self.size)
        return p


def _balance(
    law: RestoringLaw, p: Mapping[str, np.ndarray], wanted: Mapping[str, np.ndarray], amplitude: float
) -> dict[str, np.ndarray]:
    """Compute stiffness and angle of a restoring law (or one of them) that give the wanted frequency and midline.

    They solve the equations of harmonic balance for a motion of this amplitude (rad or m), by Newton's method. p: the
    law's parameters by name, each (m,), from which the method starts. wanted: the frequency (rad/s) under the name
    "stiffness", and the midline under the name of the angle, each (m,). The result has the parameters with these names,
    each (m,). `NEWTON` steps are made, and convergence is not checked. Values are not finite where a step cannot be
    computed.
    """
    names = tuple(wanted)
    wave = np.cos(2 * np.pi * (np.arange(PHASES) + 0.5) / PHASES)
    angle = next((name for name in names if name != "stiffness"), None)
    count = next(iter(wanted.values())).size
    rest = np.asarray(wanted[angle] if angle else np.zeros(count))[:, None]
    goal = np.stack([wanted[n] ** 2 if n == "stiffness" else np.zeros(count) for n in names], axis=1)
    given = {name: np.asarray(value)[:, None] for name, value in p.items()}

    def errors(x: np.ndarray) -> np.ndarray:
        """Return the left minus the right sides (..., m, k) of the k equations of harmonic balance at x (..., m, k).

        The unknowns are those in `names`: the stiffness, whose equation is that of the squared frequency, in (rad/s)²,
        and the angle, whose equation is that of the mean force, in rad/s².
        """
        force = law.force(rest + amplitude * wave, given | dict(zip(names, np.moveaxis(x, -1, 0)[..., None])))
        means = {"stiffness": 2 * np.mean(force * wave, axis=-1) / amplitude, angle: np.mean(force, axis=-1)}
        return np.stack([means[name] for name in names], axis=-1) - goal

    x = np.stack([np.broadcast_to(p[name], count) for name in names], axis=1).astype(float)
    sides = np.array([0.0, 1.0, -1.0])[:, None, None, None] * np.eye(len(names))[:, None]
    with np.errstate(all="ignore"):
        for _ in range(NEWTON):
            moves = CHANGE * np.maximum(np.abs(x), 1e-3)
            here, above, below = errors(x + moves * sides)
            slopes = np.moveaxis(above - below, 0, 2) / (2 * moves[:, None])
            determinant = np.linalg.det(slopes)
            sound = np.isfinite(slopes).all(axis=(1, 2)) & np.isfinite(determinant) & (determinant != 0)
            steps = np.full_like(x, np.nan)
            steps[sound] = np.linalg.solve(slopes[sound], here[0, sound, :, None])[..., 0]
            x = x - steps
    return dict(zip(names, x.T))


def coefficient_alone(term: DampingTerm, features: Features) -> float:
    """Return the coefficient with which one damping term alone would cause the decay of the record.

    It sets the search range of the coefficient (`ALONE`). With the equivalent damping ratio r(A) per unit of the
    coefficient c, the amplitude A falls as dA/dt = −c r(A) ω A. So c is the integral of dA/(ω A r(A)) over the fall of
    the amplitude, divided by the time from the first to the last turning point. The fall is from the largest turning
    amplitude to the last one. The last one counts as at least twice the noise, at least a thousandth of the largest,
    and at most 1 − `LEAST_DECAY` of the largest.
    """
    sizes = features.turning_amplitudes
    scale = features.amplitude / max(float(sizes[0]), 1e-300)
    first, last = float(sizes.max()), float(max(sizes[-1], 2 * features.roughness, 1e-3 * sizes.max()))
    last = min(last, (1 - LEAST_DECAY) * first)
    grid = np.geomspace(last, first, 65) * scale
    rate = 1.0 / np.array([term.ratio_per_unit(float(a), features.frequency) for a in grid])
    duration = features.turning_times[-1] - features.turning_times[0]
    return float(np.trapezoid(rate, np.log(grid)) / (features.frequency * duration))


def _next_generation(
    people: np.ndarray, genes: Genes, options: GeneticOptions, elite: int, rng: np.random.Generator
) -> np.ndarray:
    """Return the variables of the next generation, (m, d), by selection, crossover and mutation.

    people: variables of the present generation, (m, d), the best first. The first `elite` rows of the result are those
    of `people`. New variables may be outside the search range 0 to 1; those that must not be negative are reflected at
    0.
    """
    size, count = people.shape
    children = size - elite
    # The rows of `people` are sorted, the best first, so the smallest index wins a tournament.
    parents = np.min(rng.integers(size, size=(2, children, options.tournament)), axis=2)
    axes = np.linalg.svd(people - people.mean(axis=0), full_matrices=False)[2]
    turned = people @ axes.T
    mother, father = turned[parents[0]], turned[parents[1]]
    low, span = np.minimum(mother, father), np.abs(mother - father)
    mixed = low - options.blend * span + (1 + 2 * options.blend) * span * rng.random((children, count))
    step = options.mutation * np.ptp(turned, axis=0) * rng.normal(size=mixed.shape)
    mixed = (mixed + np.where(rng.random(mixed.shape) < options.mutated, step, 0.0)) @ axes
    return np.concatenate([people[:elite], np.where(genes.positive, np.abs(mixed), mixed)])


PLUGIN = Genetic()
