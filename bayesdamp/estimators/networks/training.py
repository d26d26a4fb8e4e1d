"""Tanh networks with the derivatives of their output by time and by the weights, and a search that trains them.

A jet is a function of time with its derivatives, (value, first, second) or fewer. All derivatives are worked out by
hand.
"""

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
"""Every tensor states its precision, so that torch's own default stays as it is."""


@contextmanager
def single_thread() -> Iterator[None]:
    """Run torch on one thread, so that the same seed gives the same numbers, and restore its setting afterwards."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def generator(rng: np.random.Generator) -> torch.Generator:
    """Return a generator of torch's random numbers, seeded from `rng`."""
    return torch.Generator().manual_seed(int(rng.integers(2**62)))


def layers(sizes: tuple[int, ...], random: torch.Generator, bias: float = 0.0) -> Tensor:
    """Draw the weights of a dense network with these layer sizes, in one vector: matrix, then bias, by layer.

    Matrices have variance 1/inputs (Glorot's for equal sizes), biases the standard deviation `bias`.
    """
    parts = []
    for inputs, outputs in itertools.pairwise(sizes):
        parts.append(torch.randn(outputs * inputs, generator=random, dtype=REAL) / inputs**0.5)
        parts.append(bias * torch.randn(outputs, generator=random, dtype=REAL))
    return torch.cat(parts)


def _unpack(weights: Tensor, sizes: tuple[int, ...]) -> list[tuple[Tensor, Tensor]]:
    """Split a weight vector into (matrix, bias) of each layer, shapes (outputs, inputs) and (outputs,)."""
    network, start = [], 0
    for inputs, outputs in itertools.pairwise(sizes):
        matrix = weights[start : start + outputs * inputs].reshape(outputs, inputs)
        start += outputs * inputs
        network.append((matrix, weights[start : start + outputs]))
        start += outputs
    return network


def _forward(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> tuple[Tensor, list, list]:
    """Return the output jets (n, j), and the jets into and out of every hidden layer (n, j, units)."""
    network = _unpack(weights, sizes)
    before, after = [], [inputs]
    for matrix, bias in network[:-1]:
        z = after[-1] @ matrix.T
        z[:, 0] += bias
        before.append(z)
        h = torch.tanh(z[:, 0])
        slope = 1.0 - h * h
        parts = [h]
        if z.shape[1] > 1:
            parts.append(slope * z[:, 1])
        if z.shape[1] > 2:
            parts.append(slope * (z[:, 2] - 2.0 * h * z[:, 1] ** 2))
        after.append(torch.stack(parts, dim=1))
    matrix, bias = network[-1]
    out = (after[-1] @ matrix.T)[..., 0]
    out[:, 0] += bias
    return out, before, after


def jets(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """Return the network's one output as a jet, (n, j), for input jets (n, j, sizes[0])."""
    return _forward(weights, inputs, sizes)[0]


def slopes(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """Return the derivatives of `jets` by the weights, (n, j, k)."""
    _, before, after = _forward(weights, inputs, sizes)
    network = _unpack(weights, sizes)
    n, count = inputs.shape[:2]
    # adjoint[n, output, j, unit]: derivatives of the output jet by the jets that come into a layer.
    adjoint = torch.eye(count, dtype=weights.dtype)[None, :, :, None].expand(n, count, count, 1)
    by_layer: list[Tensor] = []
    for i in reversed(range(len(network))):
        if i < len(before):
            z, h = before[i], after[i + 1]  # h = tanh(z), both as jets
            slope = (1.0 - h * h)[:, None]
            by_z = adjoint * slope[:, :, :1]
            h0, s = h[:, None, 0], slope[:, :, 0]
            bend = -2.0 * h0 * s
            if count > 1:
                by_z[:, :, 0] += adjoint[:, :, 1] * bend * z[:, None, 1]
            if count > 2:
                z1, z2 = z[:, None, 1], z[:, None, 2]
                by_z[:, :, 0] += adjoint[:, :, 2] * (bend * z2 - 2.0 * s * (s - 2.0 * h0 * h0) * z1 * z1)
                by_z[:, :, 1] += adjoint[:, :, 2] * (2.0 * bend * z1)
            adjoint = by_z
        by_matrix = torch.einsum("nkjo,nji->nkoi", adjoint, after[i])
        by_layer.append(torch.cat([by_matrix.reshape(n, count, -1), adjoint[:, :, 0]], dim=2))
        adjoint = adjoint @ network[i][0]
    return torch.cat(by_layer[::-1], dim=2)


@dataclass(frozen=True)
class Training:
    """The result of a training.

    x (k,): the best unknowns. losses, watched: the loss and the watched numbers after each round. evaluations: of the
    residuals. outcome: OK, or that the training had not converged.
    """

    x: Tensor
    losses: np.ndarray
    watched: np.ndarray
    evaluations: int
    outcome: str


FIRST, LOWEST, LESS, MORE = 1e-3, 1e-14, 0.2, 5.0
"""Damping of the first step, its lowest value, and its factors after a step that lowers the loss, if the one before did
too, and after a step that does not (conventional)."""
TRIALS = 12
"""Steps that are tried from one point."""
WINDOW = 8
"""Rounds over which the watched numbers must be steady."""


def gauss_newton(
    residuals: Callable[[Tensor], Tensor],
    linearise: Callable[[Tensor], tuple[Tensor, Tensor]],
    x: Tensor,
    rounds: int,
    watch: Callable[[Tensor], np.ndarray],
    steady: float = 2e-4,
) -> Training:
    """Minimise the sum of squares of residuals (n,) by Levenberg–Marquardt, for up to a few thousand unknowns.

    It has converged when the watched numbers have stayed within `steady` of their size for `WINDOW` rounds, while the
    loss did not fall to a tenth, or when no step lowers the loss any more.

    Parameters
    ----------
    residuals
        Maps x (k,) to the residuals (n,).
    linearise
        Maps x to the residuals and their Jacobian (n, k).
    x
        The first unknowns, (k,).
    rounds
        The largest number of steps.
    watch
        Maps x to the numbers (m,) that are sought, in units in which they are about 1.
    steady
        Largest relative change of a converged number.
    """
    losses: list[float] = []
    watched: list[np.ndarray] = []
    evaluations, damping, failed, converged = 0, FIRST, False, False
    for number in range(1, rounds + 1):
        r, jacobian = linearise(x)
        evaluations += 1
        loss = float(r @ r)
        losses.append(loss)
        watched.append(watch(x))
        if len(losses) > WINDOW:
            last = np.array(watched[-WINDOW - 1 :])
            still = bool(np.all(np.ptp(last, axis=0) <= steady * (np.abs(last[-1]) + 1e-3)))
            converged = still and loss > 0.1 * losses[-WINDOW - 1]
        if converged or not np.isfinite(loss):
            break
        gradient, hessian = jacobian.T @ r, jacobian.T @ jacobian
        unit = float(hessian.diagonal().mean()) * torch.eye(x.numel(), dtype=REAL)
        lower = np.inf
        for _ in range(TRIALS):
            factor, singular = torch.linalg.cholesky_ex(hessian + damping * unit)
            if int(singular) == 0:
                trial = x - torch.cholesky_solve(gradient[:, None], factor)[:, 0]
                r = residuals(trial)
                evaluations += 1
                lower = float(r @ r)
                if lower < loss:
                    x, damping, failed = trial, damping if failed else max(damping * LESS, LOWEST), False
                    break
            damping, failed = damping * MORE, True
        else:
            converged = True
            break
        if number == rounds:
            losses.append(lower)
            watched.append(watch(x))
    outcome = OK if converged else f"training had not converged after {rounds} rounds"
    return Training(x, np.array(losses), np.array(watched), evaluations, outcome)
