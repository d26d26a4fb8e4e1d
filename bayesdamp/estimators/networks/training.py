"""What the methods that train a network share: how torch is held, and a dense Levenberg–Marquardt search."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Self

import numpy as np
import torch
from torch import Tensor

from bayesdamp.numerics.levenberg_marquardt import Ended, Schedule, search

REAL = torch.float64
"""Every tensor says its precision: torch's own default is left as it is."""

Residuals = Callable[[Tensor], Tensor]
Linearised = Callable[[Tensor], tuple[Tensor, Tensor]]


@contextmanager
def single_thread() -> Iterator[None]:
    """torch on one thread, so that the same seed gives the same numbers; as it was before, afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def generator(rng: np.random.Generator) -> torch.Generator:
    """torch's random numbers, seeded from `rng`."""
    return torch.Generator().manual_seed(int(rng.integers(2**62)))


def layers(sizes: tuple[int, ...], random: torch.Generator, bias: float = 0.0) -> Tensor:
    """Weights of a dense network of these layer sizes, laid out in one vector: matrix, then bias, by layer.

    Matrices have variance 1/inputs (Glorot's for equal sizes), biases the standard deviation `bias`.
    """
    parts = []
    for inputs, outputs in itertools.pairwise(sizes):
        parts.append(torch.randn(outputs * inputs, generator=random, dtype=REAL) / inputs**0.5)
        parts.append(bias * torch.randn(outputs, generator=random, dtype=REAL))
    return torch.cat(parts)


def unpacked(weights: Tensor, sizes: tuple[int, ...]) -> list[tuple[Tensor, Tensor]]:
    """(matrix, bias) of each layer, shapes (outputs, inputs) and (outputs,)."""
    found, at = [], 0
    for inputs, outputs in itertools.pairwise(sizes):
        matrix = weights[at : at + outputs * inputs].reshape(outputs, inputs)
        at += outputs * inputs
        found.append((matrix, weights[at : at + outputs]))
        at += outputs
    return found


@dataclass(frozen=True)
class Trained:
    """x (k,), the loss and whatever was watched after each round, evaluations, and whether it converged."""

    x: Tensor
    losses: np.ndarray
    watched: np.ndarray
    evaluations: int
    converged: bool


SCHEDULE = Schedule(less=0.2, more=5.0, eager=False, lowest=1e-14, again=0.0)
"""How a step's damping changes (conventional)."""
TRIALS = 12
"""Steps that are tried from one point."""


@dataclass
class _Course:
    """A search under way: what `gauss_newton` is given, and what it gives back."""

    residuals: Residuals
    linearised: Linearised
    watch: Callable[[Tensor], np.ndarray]
    steady: float
    window: int
    losses: list[float] = field(default_factory=list)
    watched: list[np.ndarray] = field(default_factory=list)
    evaluations: int = 0
    converged: bool = False

    def noted(self, x: Tensor, loss: float) -> None:
        """The loss at x (k,), and what is watched there."""
        self.losses.append(loss)
        self.watched.append(self.watch(x))

    @property
    def calm(self) -> bool:
        """Whether what is watched has stopped, and the loss with it."""
        if len(self.losses) <= self.window:
            return False
        last = np.array(self.watched[-self.window - 1 :])
        still = np.all(np.ptp(last, axis=0) <= self.steady * (np.abs(last[-1]) + 1e-3))
        return bool(still) and self.losses[-1] > 0.1 * self.losses[-self.window - 1]


@dataclass(frozen=True)
class _Trial:
    """Weights that were tried, and the loss there; gain: by what that is less, −inf where it is not."""

    x: Tensor
    loss: float
    gain: float


@dataclass
class _Linear:
    """A sum of squares, linearised at x (k,): its value; of half of it gradient (k,) and Hessian (k, k). number: of
    points up to this one; tries: steps from here."""

    course: _Course
    x: Tensor
    loss: float
    gradient: Tensor
    hessian: Tensor
    number: int
    tries: int = 0

    @classmethod
    def of(cls, course: _Course, x: Tensor, number: int) -> Self:
        """At x (k,)."""
        r, jacobian = course.linearised(x)
        course.evaluations += 1
        loss = float(r @ r)
        course.noted(x, loss)
        return cls(course, x, loss, jacobian.T @ r, jacobian.T @ jacobian, number)

    def tried(self, damping: float) -> _Trial | None:
        """The step of a damping; None where the search has converged, or cannot go on."""
        self.course.converged = self.tries == TRIALS or self.course.calm
        if self.course.converged or not np.isfinite(self.loss):
            return None
        self.tries += 1
        size = float(self.hessian.diagonal().mean())
        damped = self.hessian + damping * size * torch.eye(self.x.numel(), dtype=REAL)
        factor, failed = torch.linalg.cholesky_ex(damped)
        if int(failed) != 0:
            return _Trial(self.x, np.inf, -np.inf)
        there = self.x - torch.cholesky_solve(self.gradient[:, None], factor)[:, 0]
        r = self.course.residuals(there)
        self.course.evaluations += 1
        loss = float(r @ r)
        return _Trial(there, loss, self.loss - loss if loss < self.loss else -np.inf)

    def beyond(self, trial: _Trial) -> Self:
        """Linearised where a step leads."""
        return self.of(self.course, trial.x, self.number + 1)


def gauss_newton(
    residuals: Residuals,
    linearised: Linearised,
    x: Tensor,
    rounds: int,
    watch: Callable[[Tensor], np.ndarray],
    steady: float = 2e-4,
    window: int = 8,
) -> Trained:
    """Levenberg–Marquardt on the sum of squares of residuals (n,), for up to a few thousand unknowns.

    linearised: x to residuals and their Jacobian (n, k). watch: x to the numbers (m,) that are sought, in units in
    which they are about 1. It has converged when these have stayed within `steady` of their size for `window`
    rounds, while the loss did not fall to a tenth, or where no step lowers the loss any more.
    """
    course = _Course(residuals, linearised, watch, steady, window)

    def ended(near: _Linear, trial: _Trial, damping: float) -> bool:
        return trial.gain >= 0 and near.number == rounds

    first = _Linear.of(course, x, 1)
    found: Ended[_Linear, _Trial] = search(first, ended, limit=rounds * (TRIALS + 1), schedule=SCHEDULE)
    last = found.near or first
    if found.taken is not None:
        course.noted(found.taken.x, found.taken.loss)
        last = found.taken
    losses, watched = np.array(course.losses), np.array(course.watched)
    return Trained(last.x, losses, watched, course.evaluations, course.converged)
