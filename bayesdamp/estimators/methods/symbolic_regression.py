"""Estimate damping by genetic programming over expressions for the damping force.

The method is that of section 3.8, equation 21, of the paper that `bayesdamp.estimators` cites.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field
from scipy.optimize import least_squares

from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    checked_features,
    free_start,
    further_values,
    known_restoring,
    motion,
    noise_level,
    optional_package,
    oscillator,
    solve,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import DERIVATIVES, Estimate, Problem, Refusal, Signal

if TYPE_CHECKING:
    from bayesdamp.estimators.expressions import ScoredExpression

KNOTS = (5.0, 6.0, 8.0, 11.0, 16.0, 23.0, 32.0)
"""Numbers of knots of the smoothing spline in a period that are tried. More knots resolve the damping force better, but
smooth noise less."""
MOST_NOISE = 0.1
"""A number of knots above the smallest of `KNOTS` is used only if the noise of the acceleration is then at most this
fraction of the rms damping force, and if there are at least six samples for each knot."""
HATS = 25
"""Largest number of hat functions (piecewise linear) of the velocity that represent an unknown damping force."""
FLOOR = 1e-11
"""Mean square error, as a fraction of the variance of the force, that the search in single precision just resolves; it
is added to the error of each expression before the logarithm is taken."""
NEGLIGIBLE = 1e-4
"""Additive terms of an expression are dropped if their root mean square is at most this fraction of that of the whole
expression."""


class SymbolicRegressionOptions(Options):
    """Options of the search for an expression of the damping force by genetic programming.

    searches: number of independent searches, whose Pareto fronts are joined. population: number of expressions in a
    generation of a search. generations: largest number of generations. length: largest number of nodes of an
    expression. polish: number of Levenberg–Marquardt steps that fit the constants of each expression. samples: number
    of samples on which expressions are compared during the search, half of which are copies with the signs of velocity
    and force reversed. penalty: cost of a node when one expression of the front is chosen, in units of ln(n), where n
    is the number of independent samples (1 is Schwarz's criterion).
    """

    population: int = Field(default=500, ge=20, le=100_000)
    generations: int = Field(default=40, ge=1, le=10_000)
    searches: int = Field(default=1, ge=1, le=100)
    length: int = Field(default=16, ge=3, le=100)
    polish: int = Field(default=8, ge=0, le=100)
    samples: int = Field(default=300, ge=50)
    penalty: float = Field(default=1.0, ge=0.0)


class SymbolicRegression(Estimator[SymbolicRegressionOptions]):
    """Find an expression f(θ̇) for the damping force −(θ̈ + F_rest(θ)), and read the coefficients from it.

    Genetic programming combines +, −, ×, tanh and |·| and returns the Pareto front of error and length. The constants
    of each expression are fitted again in double precision, with both sides smoothed like the record, and the
    expression with the smallest n ln(error) + penalty · length · ln(n) is chosen. A single damping term gets the
    coefficient with which it dissipates the same energy as the expression, and a sum those that fit it best. The force
    of unknown restoring parameters is removed first, by a regression together with an arbitrary function of θ̇.
    """

    by_position = "its expressions depend only on the velocity"
    options = SymbolicRegressionOptions

    def initial(
        self, signal: Signal, problem: Problem, options: SymbolicRegressionOptions, rng: np.random.Generator
    ) -> Estimate:
        """Estimate the coefficients from the chosen expression on the Pareto front; there are no standard errors.

        Unknown restoring parameters are fitted for this expression; an unknown start comes from the smoothed record.
        `details["chosen"]` is the expression as text. Raises Refusal if Operon or SymPy is not installed, if
        `checked_features` or `motion` does, if the damping force is constant or not finite, or if no expression
        describes it better than a constant.
        """
        optional_package("pyoperon")
        sympy = optional_package("sympy")
        from bayesdamp.estimators.expressions import V, front, text_of, values_of, without_the_negligible

        features = checked_features(signal)
        force = Force(signal, problem, features)
        x, y = force.thin(options.samples)
        fastest, scale = float(np.abs(x).max()), float(np.std(y))
        if not (fastest > 0 and scale > 0 and np.all(np.isfinite(y))):
            raise Refusal(
                "the damping force in the record is constant or not finite, so no expression can be searched"
            )
        candidates: list[ScoredExpression] = []
        models = 0
        for _ in range(options.searches):
            settings = options.model_dump(include={"population", "generations", "length", "polish"})
            more, count = front(x / fastest, y / scale, seed=int(rng.integers(2**31)), **settings)
            candidates, models = candidates + more, models + count
        lengths, expressions, least = [], [], np.inf
        for candidate in sorted(candidates, key=lambda c: (c.length, c.error)):
            if not (candidate.expression.has(V) and candidate.error < least):
                continue  # a shorter candidate has a smaller error
            least = candidate.error
            expression = sympy.expand(scale * candidate.expression.xreplace({V: V / fastest}))
            expression = without_the_negligible(expression, force.omega, NEGLIGIBLE)
            if expression.has(V):
                lengths.append(candidate.length)
                expressions.append(_polish(force, expression))
        if not expressions:
            raise Refusal("no expression describes the damping force better than a constant")
        errors = np.array([force.error(values_of(expression, force.omega)) for expression in expressions])
        n = force.independent
        scores = n * np.log(errors + FLOOR) + options.penalty * np.log(n) * np.array(lengths)
        chosen = int(np.argmin(np.where(np.isfinite(scores), scores, np.inf)))
        expression = without_the_negligible(expressions[chosen], force.omega, NEGLIGIBLE)
        f = values_of(expression, force.omega)
        values = _read(force, f, problem, features) | force.restoring(f)
        values |= free_start(problem, force.motion.theta0, force.motion.omega0)
        details = {"chosen": f"f(v) = {text_of(expression)}"}
        return Estimate(self.name, "initial", values, details=details, evaluations=models)


class Force:
    """Compute the damping force −(θ̈ + F_rest(θ)) along a record, and compare it with candidate forces f(θ̇).

    motion: the smoothed motion. omega: velocities at all samples that are used, (n,), rad/s. independent: effective
    number of independent samples. Unknown restoring parameters, and guessed constants of integration, add unknown parts
    to this force. They are fitted by regression and removed: before the search together with an arbitrary function of
    θ̇ (a sum of hat functions that is 0 at θ̇ = 0), and later for each candidate force.
    """

    def __init__(self, signal: Signal, problem: Problem, features: Features) -> None:
        # Use as many knots as the noise allows, to resolve the shape of the force. White noise of standard deviation σ
        # and sampling interval Δt, smoothed by a spline that follows angular frequencies up to b, has the standard
        # deviation σ √(Δt b⁵/5π) in the second derivative and σ √(Δt b³/3π) in the first.
        noise, gap = noise_level(signal), float(signal.t[-1] - signal.t[0]) / (signal.t.size - 1)
        power = 2 * (2 - DERIVATIVES[signal.quantity]) + 1
        sizes = features.turning_amplitudes
        lost = np.log(max(float(sizes.max()) / max(float(sizes[-1]), 2 * features.roughness, 1e-12), 1.05))
        ratio = lost / (features.frequency * (features.turning_times[-1] - features.turning_times[0]))
        middle = np.sqrt(features.amplitude * min(features.final_amplitude, features.amplitude))
        force = np.sqrt(2.0) * ratio * (features.frequency**2 * middle)
        knots = KNOTS[0]
        for count in KNOTS[1:]:
            passed = noise * np.sqrt(gap * (np.pi * count / features.period) ** power / (power * np.pi))
            if passed <= MOST_NOISE * force and features.period / count >= 6 * gap:
                knots = count

        self.motion = motion(signal, problem, features, knots)
        theta, self.omega, _ = self.motion.everywhere
        known, t = known_restoring(problem), self.motion.t
        form = oscillator(problem).law.linear_form(theta, known)
        self.target = -(self.motion.alpha + self.motion.project(form.offset))
        columns = [self.motion.project(column) for column in form.columns.T]
        columns += [(t - t[0]) ** j for j in range(self.motion.integrated if len(known) else 0)]
        self._count, self._decode = form.columns.shape[1], form.decode
        self._columns = np.column_stack(columns) if columns else np.zeros((t.size, 0))
        columns_of_unit_length = self._columns / np.maximum(np.linalg.norm(self._columns, axis=0), 1e-300)
        self._basis = np.linalg.svd(columns_of_unit_length, full_matrices=False)[0]
        duration = float(t[-1] - t[0])
        self.independent = t.size if self.motion.clean else max(self.motion.bandwidth * duration / np.pi, 4.0)
        self._damping_force = self.target
        if columns:
            hats = int(np.clip(self.independent // 6, 4, HATS))
            hats += 1 - hats % 2  # an odd number: one of them is centred at θ̇ = 0
            places = float(np.abs(self.omega).max()) * np.linspace(-1, 1, hats)
            shapes = np.delete(np.eye(hats), hats // 2, axis=0)
            free = [self.motion.project(np.interp(self.omega, places, shape)) for shape in shapes]
            x = solve(np.column_stack([self._columns, *free]), self.target, 1e-10)
            self._damping_force = self.target - self._columns @ x[: len(columns)]
        self._variance = float(np.var(self._damping_force))

    def thin(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Return velocities (rad/s) and forces (rad/s²) at m evenly spread samples, then their negatives, each (2m,).

        m is half of `samples`, or all samples if these are fewer. A damping force is odd in the velocity; the negatives
        enforce this.
        """
        count = min(samples // 2, self._damping_force.size)
        rows = np.linspace(0, self._damping_force.size - 1, count).round().astype(int)
        x, y = self.motion.omega[rows], self._damping_force[rows]
        return np.r_[x, -x], np.r_[y, -y]

    def misfit(self, values: np.ndarray) -> np.ndarray:
        """Return measured minus candidate damping force, (m,), in units of the measured force's standard deviation.

        values: the candidate force at the velocities `omega`, (n,). Both forces are smoothed, and compared at the m
        times of `motion`, without the part that unknown restoring parameters and guessed constants of integration can
        explain.
        """
        left = self.target - self.motion.project(values)
        return (left - self._basis @ (self._basis.T @ left)) / np.sqrt(self._variance)

    def error(self, values: np.ndarray) -> float:
        """Return the mean square of `misfit` for a candidate force: a fraction of the measured force's variance.

        values: the candidate force at the velocities `omega`, (n,).
        """
        return float(np.mean(self.misfit(values) ** 2))

    def restoring(self, values: np.ndarray) -> dict[str, float]:
        """Fit the unknown restoring parameters for a given damping force, and return them by name; {} if all are known.

        values: the damping force at the velocities `omega`, (n,).
        """
        if self._count == 0:
            return {}
        return self._decode(solve(self._columns, self.target - self.motion.project(values))[: self._count])


def _polish(force: Force, expression: Any) -> Any:
    """Return the expression with constants fitted to the damping force, or unchanged if this does not lower its error.

    The fit is a short least squares fit of `Force.misfit` that starts from the expression's own constants.
    """
    import sympy

    from bayesdamp.estimators.expressions import V

    constants = sorted(expression.atoms(sympy.Float))
    symbols = sympy.symbols(f"c:{len(constants)}", real=True)
    form = expression.xreplace(dict(zip(constants, symbols)))
    function = sympy.lambdify([V, *symbols], form, "numpy")
    start = np.array(constants, float)
    unit = np.maximum(np.abs(start), 1e-12)

    def misfit(u: np.ndarray) -> np.ndarray:
        return force.misfit(function(force.omega, *(u * unit)))

    fit = least_squares(
        lambda u: np.nan_to_num(misfit(u), nan=1e3, posinf=1e3),
        start / unit,
        method="trf",
        x_scale=1.0,
        xtol=1e-13,
        ftol=1e-13,
        gtol=1e-13,
        max_nfev=8,
    )
    is_better = np.sum(misfit(fit.x) ** 2) < np.sum(misfit(start / unit) ** 2)
    fitted = dict(zip(symbols, map(sympy.Float, (fit.x * unit).tolist())))
    return form.xreplace(fitted) if is_better else expression


def _read(force: Force, values: np.ndarray, problem: Problem, features: Features) -> dict[str, float]:
    """Return the coefficients of the problem's damping terms, by name, that describe a given damping force.

    values: this force at the velocities `Force.omega`, (n,). A single term has the coefficient with which it dissipates
    the same energy; a sum has those that fit best.
    """
    osc, project = oscillator(problem), force.motion.project
    shapes = osc.shapes(np.zeros_like(force.omega), force.omega, further_values(problem, features))
    columns, f = np.column_stack([*map(project, shapes)]), project(values)
    if len(shapes) == 1:
        return {osc.coefficients[0]: float(f @ force.motion.omega / (columns[:, 0] @ force.motion.omega))}
    return dict(zip(osc.coefficients, solve(columns, f).tolist()))


PLUGIN = SymbolicRegression()
