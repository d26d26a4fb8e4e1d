"""Who takes part."""

from __future__ import annotations

from dataclasses import dataclass

import pandas as pd

from validation.contest.environments import Child, Environment
from validation.contest.peers import (
    decrement,
    envelope,
    half_power,
    least_squares,
    ours,
    script,
    sindy,
)
from validation.contest.reply import Peer

OURS, SCRIPT = "bayesdamp", "script"
PYOMA = Environment("pyoma2", ("pyOMA-2==1.4.3",))
PYEMA = Environment("pyema", ("sdypy-EMA==0.31.0",))
NUMPYRO = Environment("numpyro", ("numpyro==0.22.0", "diffrax==0.7.2"))

VISCOUS = (
    "Its model is right where damping is viscous and the spring linear, and spends the data on nothing else."
)
FREE = "It keeps every damping with its uncertainty, and has no choice among them to get wrong."
EXACT = "It assumes that a law holds exactly, and spends no data on deviations or on other forms of damping."


@dataclass(frozen=True)
class Entry:
    """label: as the page says it. peer: what answers. better: why it is, where it is better than ours."""

    label: str
    peer: Peer
    better: str

    @property
    def environment(self) -> Environment | None:
        """Of its own, where it has one."""
        return self.peer.environment if isinstance(self.peer, Child) else None


ROSTER: dict[str, Entry] = {
    "decrement": Entry("logarithmic decrement", decrement.answer, ""),
    "hilbert": Entry("Hilbert envelope, one line", envelope.answer, ""),
    "hilbert_local": Entry("Hilbert envelope, a line at each amplitude", envelope.local, ""),
    "half_power": Entry("half-power bandwidth", half_power.answer, ""),
    "curve_fit": Entry("SciPy curve_fit, decaying cosine", least_squares.answer, VISCOUS),
    "pysindy": Entry("PySINDy", sindy.answer, ""),
    "pyoma_ssi": Entry("pyOMA2, SSI", Child(PYOMA, "pyoma.py", ("ssi",)), VISCOUS),
    "pyoma_efdd": Entry("pyOMA2, EFDD", Child(PYOMA, "pyoma.py", ("efdd",)), ""),
    "pyema": Entry("pyEMA, LSCF", Child(PYEMA, "pyema.py"), VISCOUS),
    SCRIPT: Entry("an engineer's script", script.answer, EXACT),
    OURS: Entry("bayesdamp, compare without sampling", ours.answer, ""),
    "numpyro": Entry("NumPyro (NUTS) with diffrax", Child(NUMPYRO, "numpyro_diffrax.py"), FREE),
}
"""By the name that rows have; the dearest last."""


def peers_of(rows: pd.DataFrame) -> list[str]:
    """Return the peers among rows, in the roster's order."""
    return [name for name in ROSTER if name in set(rows["peer"])]
