"""Define the peers: the methods that take part in the contest, bayesdamp and an engineer's script."""

import bayesdamp as bd
from bayesdamp.types import Signal
from bayesdamp.verdict.types import Verdict
from validation.contest import script
from validation.scoring import Peer

OURS = "bayesdamp"
"""Name under which bayesdamp takes part in the contest."""


def ours(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Return the verdict of bayesdamp on a record: that of `compare` with its default options, but without sampling.

    amplitudes: amplitudes at which damping ratios are requested, in the unit of the record.
    """
    return bd.compare(signal, amplitudes=amplitudes, sample=False).verdict


ROSTER: dict[str, Peer] = {"an engineer's script": script.answer, OURS: ours}
"""All peers (methods that take part in the contest), by their name in the column `peer` of the table."""
