"""Define the peers: functions from times (s), displacements and amplitudes (rad) to a reply.

They raise Refusal without an answer.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from validation.contest.peers import ours, script, sindy, textbook
from validation.scoring import Reply

OURS = "bayesdamp"
ROSTER: dict[str, Callable[[np.ndarray, np.ndarray, tuple[float, ...]], Reply]] = {
    "logarithmic decrement": textbook.decrement,
    "Hilbert envelope, one line": textbook.envelope,
    "Hilbert envelope, a line at each amplitude": textbook.local_envelope,
    "half-power bandwidth": textbook.half_power,
    "SciPy curve_fit, decaying cosine": textbook.decaying_cosine,
    "PySINDy": sindy.answer,
    "an engineer's script": script.answer,
    OURS: ours.answer,
}
"""All peers, by the name that the table has in its column `peer`."""
