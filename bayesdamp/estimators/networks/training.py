"""What the methods that train a network share: how torch is held, and a dense Levenberg–Marquardt search."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bayesdamp.types import OK

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
    """x (k,), the loss and whatever was watched after each round, evaluations, and OK or that it had not converged."""

    x: Tensor
    losses: np.ndarray
    watched: np.ndarray
    evaluations: int
    outcome: str


FIRST, LOWEST, LESS, MORE = 1e-3, 1e-14, 0.2, 5.0
"""How a step's damping starts and where it ends, and its factors after a step that lowers the loss, where the one
before did too, and after one that does not (conventional)."""
TRIALS = 12
"""Steps that are tried from one point."""


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
    losses: list[float] = []
    watched: list[np.ndarray] = []
    evaluations, damping, failed, converged = 0, FIRST, False, False

    def is_calm() -> bool:
        if len(losses) <= window:
            return False
        last = np.array(watched[-window - 1 :])
        still = np.all(np.ptp(last, axis=0) <= steady * (np.abs(last[-1]) + 1e-3))
        return bool(still) and losses[-1] > 0.1 * losses[-window - 1]

    for number in range(1, rounds + 1):
        r, jacobian = linearised(x)
        evaluations += 1
        loss = float(r @ r)
        losses.append(loss)
        watched.append(watch(x))
        converged = is_calm()
        if converged or not np.isfinite(loss):
            break
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        unit = float(hessian.diagonal().mean()) * torch.eye(x.numel(), dtype=REAL)
        lower = np.inf
        for _ in range(TRIALS):
            factor, singular = torch.linalg.cholesky_ex(hessian + damping * unit)
            if int(singular) == 0:
                there = x - torch.cholesky_solve(gradient[:, None], factor)[:, 0]
                r = residuals(there)
                evaluations += 1
                lower = float(r @ r)
                if lower < loss:
                    x, damping, failed = there, damping if failed else max(damping * LESS, LOWEST), False
                    break
            damping, failed = damping * MORE, True
        else:
            converged = True
            break
        if number == rounds:
            losses.append(lower)
            watched.append(watch(x))
    outcome = OK if converged else f"training had not converged after {rounds} rounds"
    return Trained(x, np.array(losses), np.array(watched), evaluations, outcome)
