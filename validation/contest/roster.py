"""List the peers that take part in the contest."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from validation.contest.environments import Child, Environment
from validation.contest.peers import ours, script, sindy, textbook
from validation.contest.peers.shared import Peer

OURS, SCRIPT = "bayesdamp", "script"
PYOMA = Environment("pyoma2", ("pyOMA-2==1.4.3",))
PYEMA = Environment("pyema", ("sdypy-EMA==0.31.0",))
NUMPYRO = Environment("numpyro", ("numpyro==0.22.0", "diffrax==0.7.2"))

VISCOUS = (
    "Its model is correct if the damping is viscous and the spring is linear, and it estimates nothing else."
)
FREE = "It estimates all damping terms with their uncertainty, so it cannot choose a wrong sum."
EXACT = "It assumes that a law holds exactly, and does not estimate deviations or other forms of damping."


@dataclass(frozen=True)
class Entry:
    """A peer that takes part.

    label: its name on the page. peer: the function that answers. better: the sentence that the page gives as the reason
    if it is nearer to the truth than bayesdamp; may be empty.
    """

    label: str
    peer: Peer
    better: str

    @property
    def environment(self) -> Environment | None:
        """The virtual environment of the peer; None if it runs in that of bayesdamp."""
        return self.peer.environment if isinstance(self.peer, Child) else None


ROSTER: dict[str, Entry] = {
    "decrement": Entry("logarithmic decrement", textbook.decrement, ""),
    "hilbert": Entry("Hilbert envelope, one line", textbook.envelope, ""),
    "hilbert_local": Entry("Hilbert envelope, a line at each amplitude", textbook.local_envelope, ""),
    "half_power": Entry("half-power bandwidth", textbook.half_power, ""),
    "curve_fit": Entry("SciPy curve_fit, decaying cosine", textbook.decaying_cosine, VISCOUS),
    "pysindy": Entry("PySINDy", sindy.answer, ""),
    "pyoma_ssi": Entry("pyOMA2, SSI", Child(PYOMA, "pyoma.py", ("ssi",)), VISCOUS),
    "pyoma_efdd": Entry("pyOMA2, EFDD", Child(PYOMA, "pyoma.py", ("efdd",)), ""),
    "pyema": Entry("pyEMA, LSCF", Child(PYEMA, "pyema.py"), VISCOUS),
    SCRIPT: Entry("an engineer's script", script.answer, EXACT),
    OURS: Entry("bayesdamp, compare without sampling", ours.answer, ""),
    "numpyro": Entry("NumPyro (NUTS) with diffrax", Child(NUMPYRO, "numpyro_diffrax.py"), FREE),
}
"""All peers, by the name that the table has in its column `peer`; the slowest is last."""


def peers_of(rows: pd.DataFrame) -> list[str]:
    """Return the names of the peers that occur in the rows, in the order of the roster."""
    return [name for name in ROSTER if name in set(rows["peer"])]
