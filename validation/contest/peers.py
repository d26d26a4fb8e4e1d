"""Define the peers, which are the methods that take part in the contest."""

import bayesdamp as bd
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict
from validation.contest import script
from validation.scoring import Peer

OURS = "bayesdamp"
"""Name of the peer that is bayesdamp."""


def ours(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Return the verdict of `compare` without sampling, with its default options."""
    return bd.compare(signal, amplitudes=amplitudes, sample=False).verdict


ROSTER: dict[str, Peer] = {"an engineer's script": script.answer, OURS: ours}
"""All peers, by the name in the column `peer` of the table."""
