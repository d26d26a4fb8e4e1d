"""Define a recurrent network that maps a sequence of vectors to one number, and train it."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bayesdamp.estimators.networks.training import REAL, Evaluated, descend, jacobian, product, single_thread

PATIENCE = 4
"""A training ends if the error on the test records has not become smaller in this many rounds in a row."""


@dataclass(frozen=True)
class RecurrentNetwork:
    """A recurrent layer over sequences, and a linear layer that maps its last state to one number, the answer.

    cell: "lstm" (Hochreiter & Schmidhuber 1997, with the forget gate of Gers, Schmidhuber & Cummins 2000) or "gru" (Cho
    and others 2014). units: number of units in the recurrent layer. inputs: number of values in each step of a
    sequence.
    """

    cell: str
    units: int
    inputs: int = 2

    @property
    def gates(self) -> int:
        """Return the number of rows of the matrix that the recurrent layer applies to (inputs, state, 1).

        It has 4 rows for each unit of an LSTM, and 3 for each unit of a GRU.
        """
        return (4 if self.cell == "lstm" else 3) * self.units

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Draw random weights (k,), uniform in ±1/√units: recurrent layer (with its bias) first, then linear layer."""
        count = self.gates * (self.inputs + self.units + 1) + self.units + 1
        return rng.uniform(-1.0, 1.0, count) / self.units**0.5

    def answers(self, weights: Tensor, sequences: Tensor) -> Tensor:
        """Return the network's output (m,) for m input sequences (m, steps, inputs).

        weights: (k,) if all sequences have the same weights, or (m, k) with a row for each sequence.
        """
        split = weights.shape[-1] - self.units - 1
        matrix = weights[..., :split].unflatten(-1, (self.gates, -1))
        of_input, of_state, bias = matrix.split([self.inputs, self.units, 1], dim=-1)
        out, shift = weights[..., split:-1], weights[..., -1]
        driven = product(of_input, sequences) + bias.mT
        state = memory = torch.zeros(len(sequences), self.units, dtype=REAL)
        for x in driven.unbind(1):
            y = product(of_state, state[:, None])[:, 0]
            if self.cell == "lstm":
                *switches, new = (x + y).chunk(4, dim=1)
                take, keep, show = map(torch.sigmoid, switches)
                memory = keep * memory + take * torch.tanh(new)
                state = show * torch.tanh(memory)
            else:
                (keep_x, reset_x, new_x), (keep_y, reset_y, new_y) = x.chunk(3, dim=1), y.chunk(3, dim=1)
                keep, reset = torch.sigmoid(keep_x + keep_y), torch.sigmoid(reset_x + reset_y)
                new = torch.tanh(new_x + reset * new_y)
                state = (1.0 - keep) * new + keep * state
        return (out * state).sum(-1) + shift

    @single_thread()
    def train(
        self,
        weights: np.ndarray,
        own: tuple[np.ndarray, np.ndarray],
        others: tuple[np.ndarray, np.ndarray],
        epochs: int,
    ) -> tuple[np.ndarray, float]:
        """Train the weights further, until the error on the sequences `others` has not fallen for `PATIENCE` rounds.

        Parameters
        ----------
        weights
            The weights (k,) so far.
        own
            The sequences (m, steps, inputs) with which the network is trained, and their right answers (m,).
        others
            Other sequences with their right answers, in the same form, whose error ends the training.
        epochs
            Largest number of rounds; each is one step of `descend` on all sequences.

        Returns
        -------
        ndarray, float
            The weights with the smallest root mean square error on `others`, and this error.
        """
        sequences, targets = torch.from_numpy(own[0]), own[1]
        unit = len(targets) ** -0.5

        def evaluate(x: np.ndarray) -> Evaluated:
            rows = torch.from_numpy(x).expand(len(targets), -1)
            return (
                unit * (self.read(x, own[0]) - own[1]),
                lambda: unit * jacobian(lambda rows: self.answers(rows, sequences), rows)[1].numpy(),
            )

        errors, best = [], weights
        for point in descend(evaluate, weights):
            errors.append(float(np.sqrt(np.mean((self.read(point.x, others[0]) - others[1]) ** 2))))
            if errors[-1] == min(errors):
                best = point.x
            if min(errors) < min(errors[-PATIENCE:]) or len(errors) > epochs:
                break
        return best, min(errors)

    @torch.no_grad()
    def read(self, weights: np.ndarray, sequences: np.ndarray) -> np.ndarray:
        """Return the answer (m,) to each sequence (m, steps, inputs) with these weights (k,), as NumPy arrays."""
        return self.answers(torch.from_numpy(weights), torch.from_numpy(sequences)).numpy()
