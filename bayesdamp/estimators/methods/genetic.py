"""A genetic search for the trajectory that fits a record (paper, section 3.11)."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.evolution.genes import Genes
from bayesdamp.estimators.shared import checked_features
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.types import Estimate, Problem, Refusal, Signal

TOLERANCE = 1e-5
"""Largest error of a trajectory, as a share of the amplitude."""


class GeneticOptions(Options):
    """The paper's components, and what it leaves open.

    population: trajectories in a generation for each unknown parameter (the paper has one; forty for six of
    them crowd together long before they are near). tournament: how many compete to be a parent.
    blend: α of the BLX-α crossover. mutation: standard deviation of the Gaussian mutation as a share of the
    range that the population spans, which is the search range at first. mutated: share of the variables that
    mutate. elite: share of the population that is kept as it is.
    generations: the most that are computed. patience: generations without a gain of a ten-thousandth in the
    misfit after which the search has converged.
    readings: samples of all trajectories of a generation at most; the misfit of a longer record is that of
    evenly spread samples.
    """

    population: int = Field(default=40, ge=8, le=10_000)
    tournament: int = Field(default=3, ge=2)
    blend: float = Field(default=0.5, ge=0.0, le=2.0)
    mutation: float = Field(default=0.1, ge=0.0, le=1.0)
    mutated: float = Field(default=0.2, ge=0.0, le=1.0)
    elite: float = Field(default=0.1, ge=0.0, lt=1.0)
    generations: int = Field(default=200, ge=1)
    patience: int = Field(default=12, ge=2)
    readings: int = Field(default=250_000, ge=10_000)


class Genetic(Estimator[GeneticOptions]):
    """Least misfit of a population of trajectories."""

    options = GeneticOptions

    def initial(
        self, signal: Signal, problem: Problem, options: GeneticOptions, rng: np.random.Generator
    ) -> Estimate:
        """The fittest individual of the last generation, by the misfit of its trajectory."""
        seen = checked_features(signal)
        genes = Genes(signal, problem, seen)
        people = rng.random((options.population * len(genes.names), len(genes.names)))
        size = float(np.abs(seen.turning_amplitudes).max())
        fitness = _Fitness(signal, genes, size, max(options.readings // len(people), 200))
        misfit = fitness(people)
        best, mean, leaders = [], [], []
        while True:
            order = np.argsort(misfit, kind="stable")
            people, misfit = people[order], misfit[order]
            best.append(float(misfit[0]))
            mean.append(float(np.mean(misfit[np.isfinite(misfit)])) if np.isfinite(misfit[0]) else np.inf)
            leaders.append(people[0])
            if len(best) > options.generations or _settled(best, people, options.patience):
                break
            people = _next_generation(people, misfit, genes, options, rng)
            misfit = fitness(people)
        if not np.isfinite(best[-1]):
            raise Refusal("every trajectory within the search range escapes")
        found = genes.decode(np.array(leaders))
        return Estimate(
            self.name,
            "initial",
            {name: float(found[name][-1]) for name in genes.names},
            trace={
                "best_misfit": np.array(best),
                "mean_misfit": np.array(mean),
                **{name: found[name] for name in genes.names},
            },
            details={
                "generations": len(best) - 1,
                "searched": [
                    f"{name}: {low:.4g} to {high:.4g}"
                    for name, low, high in zip(genes.labels, genes.low, genes.high)
                ],
            },
            evaluations=fitness.evaluations,
        )


def _settled(best: list[float], people: np.ndarray, patience: int) -> bool:
    """Whether the best has not gained for `patience` generations, or all are the same to nine digits."""
    if np.all(np.ptp(people, axis=0) <= 1e-9 * np.abs(people[0])):
        return True
    return len(best) > patience and best[-1] > (1 - 1e-4) * best[-1 - patience]


def _next_generation(
    people: np.ndarray, misfit: np.ndarray, genes: Genes, options: GeneticOptions, rng: np.random.Generator
) -> np.ndarray:
    """People (m, d) in order of misfit (m,) to the next generation (m, d), the elite first."""
    size, count = people.shape
    kept = max(1, round(options.elite * size))
    children = size - kept
    # The people are in order, so that the least index wins a tournament.
    parents = np.min(rng.integers(size, size=(2, children, options.tournament)), axis=2)
    axes = np.linalg.svd(people - people.mean(axis=0), full_matrices=False)[2]
    turned = people @ axes.T
    one, other = turned[parents[0]], turned[parents[1]]
    low, span = np.minimum(one, other), np.abs(one - other)
    mixed = low - options.blend * span + (1 + 2 * options.blend) * span * rng.random((children, count))
    step = options.mutation * np.ptp(turned, axis=0) * rng.normal(size=mixed.shape)
    mixed = (mixed + np.where(rng.random(mixed.shape) < options.mutated, step, 0.0)) @ axes
    return np.concatenate([people[:kept], np.where(genes.positive, np.abs(mixed), mixed)])


class _Fitness:
    """Root mean square misfit of trajectories to a record, in the unit of the record; inf where one escapes."""

    def __init__(self, signal: Signal, genes: Genes, size: float, samples: int) -> None:
        self.genes = genes
        rows = np.unique(np.linspace(0, signal.t.size - 1, min(samples, signal.t.size)).round().astype(int))
        self.y, reference = signal.y[rows], self.genes.base
        self.trajectories = Trajectories(
            genes.osc, signal.t[rows], signal.quantity, reference, TOLERANCE * size
        )
        self.evaluations = 0

    def __call__(self, u: np.ndarray) -> np.ndarray:
        self.evaluations += u.shape[0]
        misfit = np.sqrt(np.mean((self.trajectories.many(self.genes.decode(u)) - self.y) ** 2, axis=1))
        return np.where(np.isfinite(misfit), misfit, np.inf)


PLUGIN = Genetic()
