"""Genetic programming over expressions for the damping force (paper, section 3.8, equation 21)."""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.optimize import least_squares

from bayesdamp.estimators._protocol import Estimator, Options
from bayesdamp.estimators.evolution.expressions import Expression
from bayesdamp.estimators.evolution.force import Force
from bayesdamp.estimators.evolution.operon import Found, front
from bayesdamp.estimators.search import least_over_further
from bayesdamp.estimators.shared import (
    beside_coefficients,
    checked_features,
    epsilon_of,
    free_names,
    further_priors,
    oscillator,
    solved,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Estimate, Problem, Refusal, Signal

FLOOR = 1e-11
"""Share of the force's variance that single precision cannot see below."""
SAME = 1e-3
"""Two forces are the same where they differ by no more than this share, root mean square."""
SWITCH = 0.03
"""A width of friction's switch is the one that is known within this share of the peak velocity."""
KEPT = 1e-4
"""Products of an expression that are less than this share of it, root mean square, are dropped."""


class SymbolicRegressionOptions(Options):
    """population, generations: of each of `searches` independent searches, whose fronts are joined.

    length: the most nodes of an expression. polish: steps of Levenberg–Marquardt for the constants of each.
    samples: of the record, evenly spread, half of them mirrored, on which expressions are compared while
    they are bred.
    penalty: what a node costs, in units of ln(n) of Schwarz's criterion, n the independent samples.
    """

    population: int = Field(default=500, ge=20, le=100_000)
    generations: int = Field(default=40, ge=1, le=10_000)
    searches: int = Field(default=1, ge=1, le=100)
    length: int = Field(default=16, ge=3, le=100)
    polish: int = Field(default=8, ge=0, le=100)
    samples: int = Field(default=300, ge=50)
    penalty: float = Field(default=1.0, ge=0.0)


class SymbolicRegression(Estimator[SymbolicRegressionOptions]):
    """An expression f(θ̇) for −(θ̈ + F_rest(θ)), bred from +, −, ×, tanh and |·|; the damping is read from it.

    Two objectives, error and length, give a Pareto front. Each expression there is written as a sum of
    products and its constants are fitted once more in double precision, with the smoothing of the record
    applied to both sides; the one with the least n ln(error) + penalty · length · ln(n) is chosen.
    Where it is the damping law itself, with a width ε of its own in tanh(θ̇/ε) if it is close to the
    known one, its constants are the coefficients; else the law is sought that does the same work over the
    record's motion (an expression with a free factor does the work of the measured force itself), or, if it
    is a sum, the one that is nearest to the expression there. Of restoring
    parameters that are not known, a regression with an arbitrary function of θ̇ takes the force off first.
    """

    by_position = "its expressions are of the velocity alone"
    options = SymbolicRegressionOptions

    def initial(
        self, signal: Signal, problem: Problem, options: SymbolicRegressionOptions, rng: np.random.Generator
    ) -> Estimate:
        """Coefficients from the expression on the Pareto front that was chosen for the force."""
        seen = checked_features(signal)
        force = Force(signal, problem, seen)
        x, y = force.thinned(options.samples)
        fastest, scale = float(np.abs(x).max()), float(np.std(y))
        if not (fastest > 0 and scale > 0 and np.all(np.isfinite(y))):
            raise Refusal("the record shows no damping force to search an expression for")
        found: list[Found] = []
        models = 0
        for _ in range(options.searches):
            more, count = front(
                x / fastest,
                y / scale,
                seed=int(rng.integers(2**31)),
                population=options.population,
                generations=options.generations,
                length=options.length,
                polish=options.polish,
            )
            found, models = found + more, models + count
        best = [
            (one, one.expression.stretched(fastest).scaled(scale).without_the_negligible(force.omega, KEPT))
            for one in _pareto([one for one in found if one.expression.depends])
        ]
        best = [(one, _polished(force, expression)) for one, expression in best if expression.depends]
        if not best:
            raise Refusal("no expression says more of the damping force than a constant")
        errors = np.array([force.error(expression) for _, expression in best])
        n = force.independent
        scores = n * np.log(errors + FLOOR) + options.penalty * np.log(n) * np.array(
            [one.length for one, _ in best]
        )
        chosen = int(np.argmin(np.where(np.isfinite(scores), scores, np.inf)))
        expression = best[chosen][1].without_the_negligible(force.omega, KEPT)
        values, width, how = _read(force, expression, problem, seen)
        law = force.restoring(expression)
        start = {"theta0": force.theta0, "omega0": force.omega0}
        values |= {name: {**law, **start}[name] for name in free_names(problem)}
        return Estimate(
            self.name,
            "initial",
            values,
            trace={
                "length": np.array([float(one.length) for one, _ in best]),
                "relative_error": np.sqrt(errors),
            },
            details={
                "chosen": f"f(v) = {expression}",
                "read": how,
                "epsilon_found": width if width is not None else "none",
                "pareto_chosen": chosen,
                "pareto_length": [one.length for one, _ in best],
                "pareto_error": [float(np.sqrt(error)) for error in errors],
                "pareto_expression": [str(expression) for _, expression in best],
            },
            evaluations=models,
        )


def _pareto(found: list[Found]) -> list[Found]:
    """Those that no other one beats in both error and length, shortest first."""
    best: list[Found] = []
    for one in sorted(found, key=lambda one: (one.length, one.error)):
        if np.isfinite(one.error) and (not best or one.error < best[-1].error):
            best.append(one)
    return best


def _polished(force: Force, expression: Expression) -> Expression:
    """The expression with the constants of least squares, as far as that makes it better."""
    start = expression.constants()
    unit = np.maximum(np.abs(start), 1e-12)
    misfit = least_squares(
        lambda u: np.nan_to_num(force.misfit(expression.with_constants(u * unit)), nan=1e3, posinf=1e3),
        start / unit,
        method="trf",
        x_scale=1.0,
        xtol=1e-13,
        ftol=1e-13,
        gtol=1e-13,
        max_nfev=8,
    )
    better = expression.with_constants(misfit.x * unit)
    return better if force.error(better) < force.error(expression) else expression


def _read(
    force: Force, expression: Expression, problem: Problem, seen: Features
) -> tuple[dict[str, float], float | None, str]:
    """(coefficients, the width of the expression's own switch, how they were read)."""
    terms = oscillator(problem).terms
    f, epsilon = expression(force.omega), epsilon_of(problem, seen)
    beside = beside_coefficients(problem, seen)

    def shapes(width: float) -> np.ndarray:
        still, q = np.zeros_like(force.omega), beside
        return np.column_stack(
            [np.asarray(t.force(still, force.omega, width, *(q[n] for n in t.further))) for t in terms]
        )

    def left(further: dict[str, float]) -> float:
        beside.update(further)
        columns = shapes(epsilon)
        return float(np.sum((f - columns @ solved(columns, f)) ** 2))

    further = least_over_further(further_priors(problem, seen), left)
    beside.update(further)
    fastest = float(np.abs(force.omega).max())
    own = [abs(width) for width in expression.widths()] if any(term.switches for term in terms) else []
    own = sorted((w for w in own if w > 0), key=lambda width: abs(width - epsilon))
    switch = own[0] if own else None
    near = [width for width in own if abs(width - epsilon) <= SWITCH * fastest]
    for width in [*near[:1], epsilon]:
        columns = shapes(width)
        c = solved(columns, f)
        if np.sqrt(np.mean((f - columns @ c) ** 2)) <= SAME * np.sqrt(np.mean(f**2)):
            return {**_named(terms, c), **further}, switch, "the expression is the law: its own constants"
    smooth = np.column_stack([force.motion.project(column) for column in shapes(epsilon).T])
    if len(terms) == 1:
        c = np.atleast_1d(force.motion.project(f) @ force.motion.omega / (smooth[:, 0] @ force.motion.omega))
        return {**_named(terms, c), **further}, switch, "the law that does the same work"
    c = solved(smooth, force.motion.project(f))
    return {**_named(terms, c), **further}, switch, "the law nearest to the expression"


def _named(terms: tuple, c: np.ndarray) -> dict[str, float]:
    return {term.parameter: float(value) for term, value in zip(terms, c)}


PLUGIN = SymbolicRegression()
