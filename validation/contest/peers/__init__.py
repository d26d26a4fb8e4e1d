"""Define the peers, which are the methods that take part in the contest.

Each is a function that maps times (s), displacements (rad) and amplitudes (rad) to a reply with the damping ratios. It
raises Refusal if it has no answer.
"""

from collections.abc import Callable

import numpy as np

from validation.contest.peers import ours, script
from validation.scoring import Reply

OURS = "bayesdamp"
"""Name of the peer that is bayesdamp."""
ROSTER: dict[str, Callable[[np.ndarray, np.ndarray, tuple[float, ...]], Reply]] = {
    "an engineer's script": script.answer,
    OURS: ours.answer,
}
"""All peers, by the name in the column `peer` of the table."""
