"""Define the peer bayesdamp: `compare` without sampling, with its default options."""

import numpy as np

from bayesdamp.types import Signal
from validation.scoring import Reply, reply_of


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Return the answer on a record: times in s, displacements and amplitudes in rad.

    Raises Refusal, with the sentence of the verdict, if it has no damping ratios.
    """
    import bayesdamp as bd

    return reply_of(
        bd.compare(Signal(t - t[0], y, name="record"), amplitudes=amplitudes, sample=False).verdict
    )
