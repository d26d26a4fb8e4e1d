"""Provide derivatives, dense networks, training and scaled records for the estimators with a network."""

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its modules when they are used
import torch
from torch import Tensor

from bayesdamp.estimators.shared import epsilon_of, oscillator, ratios_per_unit, start_parameters, thin_record
from bayesdamp.physics.damping import EXACT
from bayesdamp.physics.forces import with_names
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import DERIVATIVES, OK, Problem, Refusal, Signal

REAL = torch.float64
"""Type of every tensor. We pass it wherever a tensor is created, so that torch's default type stays unchanged."""
MOST_SAMPLES = 750
"""Largest number of samples of a record that are used for the training; a longer record is thinned (conventional)."""
BIAS = 0.5
"""Standard deviation of the random biases of a network before its training."""
FIRST, LOWEST, LESS, MORE = 1e-3, 1e-14, 0.2, 5.0
"""Numbers for λ, the damping of Levenberg's method (conventional). `FIRST`: its value at the first step. `LOWEST`: its
smallest value. `LESS`: its factor after a step that lowers the loss, applied only if the step tried before did so too.
`MORE`: its factor after a step that does not lower the loss."""
AHEAD, STRAIGHT = 0.1, 0.75
"""Numbers for the geodesic acceleration, a correction of a step for the curvature of the residuals (Transtrum & Sethna
2012). `AHEAD`: fraction of the step over which the second derivative along it is measured. `STRAIGHT`: largest length
of the correction, as a fraction of the length of the step."""
TRIALS = 12
"""Largest number of steps that are tried from one point; if none lowers the loss, the descent ends (conventional)."""
WINDOW = 8
"""Number of rounds over which the numbers that `train` watches must stay unchanged for the training to count as
converged (conventional)."""


@contextmanager
def single_thread() -> Iterator[None]:
    """Run torch on one thread, so that the same seed gives the same numbers, and restore its setting afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def jacobian(function: Callable[[Tensor], Tensor], rows: Tensor) -> tuple[Tensor, Tensor]:
    """Return the values of a function at n rows, and the derivatives of each value by the elements of its row.

    rows: (n, k). function: computes the values of all rows at once, (n,) or, with m values for each row, (n, m). The
    derivatives are (n, k) or (n, m, k). A value may depend only on its own row. Therefore the derivatives of the first
    value of every row are the gradient of the sum of these n values, and so on: m gradients are enough.
    """
    rows = rows.detach().requires_grad_()
    values = function(rows)
    columns = [values] if values.ndim == 1 else values.unbind(1)
    slopes = [torch.autograd.grad(column.sum(), rows, retain_graph=True)[0] for column in columns]
    return values.detach(), slopes[0] if values.ndim == 1 else torch.stack(slopes, 1)


class _Product(torch.autograd.Function):
    """Multiply each row of the inputs by the same matrix; the derivatives by the matrix are those of each row."""

    @staticmethod
    def forward(ctx: Any, matrices: Tensor, inputs: Tensor) -> Tensor:
        ctx.save_for_backward(matrices[0], inputs)
        return inputs @ matrices[0].mT

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Tensor) -> tuple[Tensor, Tensor]:
        (slopes,), (matrix, inputs) = grad_outputs, ctx.saved_tensors
        # For j = 1 broadcasting is several times faster than many small products of matrices.
        by_matrix = slopes.mT * inputs if inputs.shape[1] == 1 else slopes.mT @ inputs
        return by_matrix, slopes @ matrix


def product(matrix: Tensor, inputs: Tensor) -> Tensor:
    """Return the products of a matrix (o, i) with inputs (n, j, i), as rows (n, j, o).

    For the derivatives of each row by the matrix (`jacobian`), `matrix` has n copies of it, (n, o, i), all equal.
    """
    return inputs @ matrix.mT if matrix.ndim == 2 else _Product.apply(matrix, inputs)


@dataclass(frozen=True)
class DenseNetwork:
    """A network with tanh in its hidden layers and one output.

    Weights are a vector (k,), or one for each row of inputs, (n, k).
    sizes: numbers of units in the layers, from the inputs to the output.
    """

    sizes: tuple[int, ...]

    @property
    def count(self) -> int:
        """Return the number of weights."""
        return sum(outputs * (inputs + 1) for inputs, outputs in itertools.pairwise(self.sizes))

    def draw(self, rng: np.random.Generator) -> Tensor:
        """Draw random first weights (k,): those of a matrix have the variance 1/inputs, biases the sd `BIAS`."""
        weights = torch.from_numpy(rng.standard_normal(self.count))
        for matrix, bias in self._layers(weights):
            matrix /= matrix.shape[1] ** 0.5
            bias *= BIAS
        return weights

    def output(self, weights: Tensor, inputs: Tensor) -> Tensor:
        """Return the jets of the output, (n, j), from the jets of the inputs, (n, j, sizes[0]).

        A jet contains a value and its first j − 1 time derivatives. weights: one vector (k,), or one for each row of
        inputs, (n, k).
        """
        *hidden, last = self._layers(weights)
        return _affine(*last, _hidden(hidden, inputs))[..., 0]

    def last_hidden(self, weights: Tensor, inputs: Tensor) -> Tensor:
        """Return the jets of the last hidden layer, (n, j, sizes[-2]), for those of the inputs, (n, j, sizes[0]).

        A jet contains a value and its first j − 1 time derivatives. weights: as in `output`.
        """
        return _hidden(self._layers(weights)[:-1], inputs)

    def _layers(self, weights: Tensor) -> list[tuple[Tensor, Tensor]]:
        """Return views of weights as (matrix, bias) of each layer, (…, outputs, inputs) and (…, outputs)."""
        shapes = [(outputs, inputs) for inputs, outputs in itertools.pairwise(self.sizes)]
        parts = weights.split([size for o, i in shapes for size in (o * i, o)], dim=-1)
        matrices = (part.view(*part.shape[:-1], *shape) for part, shape in zip(parts[::2], shapes))
        return list(zip(matrices, parts[1::2]))


def _hidden(layers: list[tuple[Tensor, Tensor]], inputs: Tensor) -> Tensor:
    for matrix, bias in layers:
        inputs = _tanh(_affine(matrix, bias, inputs))
    return inputs


def _tanh(jet: Tensor) -> Tensor:
    """Return tanh of values and, by the chain rule, its first j − 1 time derivatives, (n, j, …), with j from 1 to 3."""
    value, *rates = jet.unbind(1)
    result = torch.tanh(value)
    slope = 1.0 - result**2
    parts = [result, *(slope * rate for rate in rates)]
    if len(rates) == 2:
        parts[2] = parts[2] - 2.0 * result * rates[0] * parts[1]
    return torch.stack(parts, 1)


def _affine(matrix: Tensor, bias: Tensor, inputs: Tensor) -> Tensor:
    """Return matrix @ inputs + bias and its time derivatives, (n, j, outputs); the bias has no time derivatives.

    inputs: values and their first j − 1 time derivatives, (n, j, inputs).
    """
    constant = torch.nn.functional.pad(bias[..., None, :], (0, 0, 0, inputs.shape[1] - 1))
    return product(matrix, inputs) + constant


class _Mathematics:
    """Replace the modules `math` and `numpy`: an attribute is torch's function of the same name, or a constant.

    Raises Refusal if torch has no such function.
    """

    def __getattr__(self, name: str) -> Any:
        value = getattr(math, name, None) or getattr(np, name)
        if not callable(value):
            return value
        function = getattr(torch, {"fabs": "abs", "power": "pow"}.get(name, name), None)
        if function is None:
            raise Refusal(f"the force uses the function {name}, which torch does not have")
        return lambda *numbers: function(*(torch.as_tensor(x, dtype=REAL) for x in numbers))


@lru_cache(maxsize=256)
def on_tensors(kernel: Callable[..., Any]) -> Callable[..., Tensor]:
    """Convert a kernel, the Python function of a force of single numbers, to a function that torch can differentiate.

    Each argument of the new function is a tensor (n,), a number, or a tuple of these where the kernel takes a tuple; it
    returns a tensor (n,). A kernel that branches with `if` is called for one number after the other. The new function
    raises Refusal if the kernel uses a function that torch does not have.
    """
    on_rows = with_names(kernel, _Mathematics())

    def evaluate(x: Tensor, *others: Any) -> Tensor:
        try:
            return on_rows(x, *others)
        except RuntimeError:  # the kernel branches, but a tensor has no truth value
            return torch.stack([on_rows(*(_row(a, i) for a in (x, *others))) for i in range(x.numel())])

    return evaluate


def _row(argument: Any, i: int) -> Any:
    if isinstance(argument, tuple):
        return tuple(_row(part, i) for part in argument)
    return argument[i] if isinstance(argument, Tensor) and argument.ndim else argument


Evaluated = tuple[np.ndarray, Callable[[], np.ndarray]]
"""Residuals (n,) at a point, and a function that computes their Jacobian (n, k) there."""


class Round(NamedTuple):
    """A point of the minimisation `descend`: its start, or the end of a step that lowered the loss.

    x: the unknowns, (k,). loss: sum of squares of the residuals there. evaluations: number of evaluations of the
    residuals so far.
    """

    x: np.ndarray
    loss: float
    evaluations: int


def descend(evaluate: Callable[[np.ndarray], Evaluated], x: np.ndarray) -> Iterator[Round]:
    """Lower the sum of squares of residuals (n,) step by step, for up to a few thousand unknowns.

    It uses Levenberg's method with geodesic acceleration (Transtrum & Sethna 2012, arXiv:1201.5885): a step is bent by
    the residuals' second derivative along it, and refused if it bends too much. All unknowns have the same damping
    λ. (If it were scaled by their curvature, as Marquardt proposed, weights without effect could grow without bounds.)
    The descent ends when none of `TRIALS` steps from a point lowers the loss.

    Parameters
    ----------
    evaluate
        Maps x (k,) to the residuals there, and to a function that computes their Jacobian.
    x
        The first unknowns, (k,).

    Yields
    ------
    Round
        The start, and the end of each step that lowered the loss.
    """
    evaluations, damping, failed = 1, FIRST, False
    r, derive = evaluate(x)
    while True:
        jacobian, loss = derive(), float(r @ r)
        yield Round(x, loss, evaluations)
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        diagonal, unit = hessian.diagonal().copy(), float(hessian.diagonal().mean())
        for _ in range(TRIALS):
            np.fill_diagonal(hessian, diagonal + damping * unit)
            try:
                factor = scipy.linalg.cho_factor(hessian, check_finite=False)
            except np.linalg.LinAlgError:
                damping, failed = damping * MORE, True
                continue
            step = -scipy.linalg.cho_solve(factor, gradient, check_finite=False)
            curvature = 2 / AHEAD * ((evaluate(x + AHEAD * step)[0] - r) / AHEAD - jacobian @ step)
            bend = -scipy.linalg.cho_solve(factor, jacobian.T @ curvature, check_finite=False) / 2
            end, derive = evaluate(x + step + bend)
            evaluations += 2
            if np.linalg.norm(bend) <= STRAIGHT * np.linalg.norm(step) and float(end @ end) < loss:
                x, r = x + step + bend, end
                damping, failed = damping if failed else max(damping * LESS, LOWEST), False
                break
            damping, failed = damping * MORE, True
        else:
            return


@dataclass(frozen=True)
class Training:
    """The result of a training.

    x (k,), loss, watched (m,): the unknowns, the loss and the watched numbers of the last round. evaluations: number of
    evaluations of the residuals. outcome: OK, or a sentence that it had not converged. It is OK too if the loss is not
    finite, which the caller must check.
    """

    x: np.ndarray
    loss: float
    watched: np.ndarray
    evaluations: int
    outcome: str


def train(
    descent: Iterator[Round],
    rounds: int,
    watch: Callable[[np.ndarray], np.ndarray],
    steady: float = 2e-4,
    samples: float = np.inf,
) -> Training:
    """Train until the watched numbers, such as coefficients, no longer change, or more rounds would only fit noise.

    The watched numbers no longer change if in `WINDOW` rounds their relative change was at most `steady`, and the loss
    did not fall to a tenth. Only noise is fitted if the loss has fallen by less than the fraction 1/`samples` in these
    rounds, which is the mean effect of one superfluous unknown. The training also ends if the loss is not finite.

    Parameters
    ----------
    descent
        The rounds of `descend`.
    rounds
        The largest number of rounds after the first, in each of which a step lowered the loss.
    watch
        Function that maps the unknowns to the watched numbers (m,), in units in which they are about 1.
    steady
        Largest relative change of a converged number.
    samples
        Number of samples with independent noise whose mean square misfit is the loss. With infinity, the default, the
        test for noise never ends the descent.

    Returns
    -------
    Training
        The last round. If the training did not converge within `rounds`, the outcome says so. It is OK if the loss is
        not finite, or if no further step lowers it.
    """
    course: list[Round] = []
    watched: list[np.ndarray] = []
    outcome = OK
    for point in descent:
        course.append(point)
        watched.append(watch(point.x))
        if not np.isfinite(point.loss):
            break
        if len(course) > WINDOW:
            last = np.array(watched[-WINDOW - 1 :])
            still = bool(np.all(np.ptp(last, axis=0) <= steady * (np.abs(last[-1]) + 1e-3)))
            ratio = course[-WINDOW - 1].loss / point.loss
            if (still and ratio < 10.0) or ratio < 1.0 + 1.0 / samples:
                break
        if len(course) > rounds:
            outcome = f"training had not converged after {rounds} rounds"
            break
    return Training(course[-1].x, course[-1].loss, watched[-1], course[-1].evaluations, outcome)


class ScaledRecord:
    """A record and its oscillator, scaled by the record's amplitude a and angular frequency w.

    It is the base class of `Collocation` and `Shooting`. a: displacement amplitude at the first sample, in rad or m. w:
    in rad/s. t, recorded: times in s and samples, (n,) each, at most `MOST_SAMPLES`. order: order of the recorded
    derivative of the displacement. y: the samples (a displacement minus the equilibrium) in units of a wᵒʳᵈᵉʳ. rest:
    the equilibrium, in rad or m. base: values of all parameters but the coefficients, by name. ratios: equivalent
    damping ratio per unit of each coefficient. coefficients, restoring: names of the damping coefficients, and of the
    unknown restoring parameters. is_given (2,): 1 where the angle or the velocity at the start is known, else 0.
    known_begin (2,): the values of these two, the angle relative to the equilibrium, in units of a and a w.
    """

    def __init__(self, signal: Signal, problem: Problem, features: Features) -> None:
        osc, known = oscillator(problem), problem.system.known
        self.base = start_parameters(signal, problem, features)
        self.a, self.w, self.order = features.amplitude, features.frequency, DERIVATIVES[signal.quantity]
        self.rest = features.rest if self.order == 0 else osc.equilibrium(self.base)
        self.ratios = ratios_per_unit(problem, features)
        self.coefficients = osc.coefficients
        self.restoring = tuple(name for name in osc.law.parameters if name not in known)
        self._osc, self._epsilon = osc, epsilon_of(problem, features)
        self.t, self.recorded = thin_record(signal, features, MOST_SAMPLES)
        middle = self.rest if self.order == 0 else 0.0
        self.y = torch.from_numpy((self.recorded - middle) / (self.a * self.w**self.order))
        self.is_given = torch.tensor([name in known for name in ("theta0", "omega0")], dtype=REAL)
        begin = [known.get("theta0", 0.0) - self.rest, known.get("omega0", 0.0) / self.w]
        self.known_begin = torch.tensor(begin, dtype=REAL) / self.a

    def restoring_force(self, theta: Tensor, values: Tensor) -> Tensor:
        """Return the restoring force per unit of inertia, (n,), in rad/s², at angles theta (n,) in rad, not scaled.

        values: the unknown restoring parameters in their units, in the order of `restoring`, (k,) or one row for each
        angle, (n, k).
        """
        p = self.base | dict(zip(self.restoring, values.unbind(-1)))
        law = self._osc.law
        return on_tensors(law.kernel)(theta, tuple(p[name] for name in law.parameters))

    def damping_shapes(self, omega: Tensor) -> Tensor:
        """Return the damping force per unit of each coefficient, (n, terms), at velocities (n,) in rad/s.

        The velocities are not scaled. The displacement is 0, because the terms must not depend on it.
        """
        # If ε is 0, friction jumps with the sign of the velocity.
        width = self._epsilon or torch.where(omega == 0.0, 1.0, EXACT * omega.detach().abs())
        still = torch.zeros_like(omega)
        forces = (
            on_tensors(t.kernel)(still, omega, width, *(self.base[n] for n in t.given))
            for t in self._osc.terms
        )
        return torch.stack(tuple(forces), -1)
