"""A tanh network with the derivatives of its output by time, and theirs by the weights, worked out by hand.

A jet is a function of time with its derivatives, (value, first, second) or fewer.
"""

from __future__ import annotations

import torch
from torch import Tensor

from bayesdamp.estimators.networks.training import unpacked


def _activated(z: Tensor) -> Tensor:
    """tanh of jets z (n, j, units)."""
    h = torch.tanh(z[:, 0])
    slope = 1.0 - h * h
    parts = [h]
    if z.shape[1] > 1:
        parts.append(slope * z[:, 1])
    if z.shape[1] > 2:
        parts.append(slope * (z[:, 2] - 2.0 * h * z[:, 1] ** 2))
    return torch.stack(parts, dim=1)


def _through(adjoint: Tensor, z: Tensor, h: Tensor) -> Tensor:
    """Derivatives by the jets h = tanh(z) turned into those by z, (n, outputs, j, units)."""
    slope = (1.0 - h * h)[:, None]
    found = adjoint * slope[:, :, :1]
    if z.shape[1] > 1:
        z1, h0, s = z[:, None, 1], h[:, None, 0], slope[:, :, 0]
        bend = -2.0 * h0 * s
        found[:, :, 0] += adjoint[:, :, 1] * bend * z1
        if z.shape[1] > 2:
            z2 = z[:, None, 2]
            found[:, :, 0] += adjoint[:, :, 2] * (bend * z2 - 2.0 * s * (s - 2.0 * h0 * h0) * z1 * z1)
            found[:, :, 1] += adjoint[:, :, 2] * (2.0 * bend * z1)
    return found


def _forward(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> tuple[Tensor, list, list]:
    """Output jets (n, j), and the jets into and out of every hidden layer."""
    network = unpacked(weights, sizes)
    before, after = [], [inputs]
    for matrix, bias in network[:-1]:
        z = after[-1] @ matrix.T
        z[:, 0] += bias
        before.append(z)
        after.append(_activated(z))
    matrix, bias = network[-1]
    out = (after[-1] @ matrix.T)[..., 0]
    out[:, 0] += bias
    return out, before, after


def jets(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """The network's one output as a jet, (n, j), for input jets (n, j, sizes[0])."""
    return _forward(weights, inputs, sizes)[0]


def slopes(weights: Tensor, inputs: Tensor, sizes: tuple[int, ...]) -> Tensor:
    """Derivatives of `jets` by the weights, (n, j, k)."""
    _, before, after = _forward(weights, inputs, sizes)
    network = unpacked(weights, sizes)
    n, count = inputs.shape[:2]
    # adjoint[n, output, j, unit]: of the output jet's components by the jets that come into a layer.
    adjoint = torch.eye(count, dtype=weights.dtype)[None, :, :, None].expand(n, count, count, 1)
    found: list[Tensor] = []
    for i in reversed(range(len(network))):
        if i < len(before):
            adjoint = _through(adjoint, before[i], after[i + 1])
        by_matrix = torch.einsum("nkjo,nji->nkoi", adjoint, after[i])
        found.append(torch.cat([by_matrix.reshape(n, count, -1), adjoint[:, :, 0]], dim=2))
        adjoint = adjoint @ network[i][0]
    return torch.cat(found[::-1], dim=2)
