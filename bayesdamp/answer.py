"""The verdict on one signal, as the command line and Python call it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.deviation.findings import SENSOR, findings
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.weighing import Known
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.decide import decide
from bayesdamp.verdict.types import Grade, Verdict, Window


def answer(
    signal: Signal,
    amplitudes: Sequence[float] | None = None,
    *,
    deviation: str = "auto",
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    sensor: float = SENSOR,
    measured: bool = True,
    seed: int = 0,
) -> Verdict:
    """Which damping a signal has, how large it is and how well the law holds.

    amplitudes: where the damping ratio is given (rad or m). deviation: "none", laws hold exactly; "law" or "auto", they
    may hold approximately. sensor: relative linearity of the sensor, the floor of every rate. A signal on which nothing
    can be said has a verdict of the grade `not_weighed` with the reason as its sentence.
    """
    approximate = deviation != "none"
    try:
        weighing = weighing_of(
            signal, damping=damping, restoring=restoring, known=known, priors=priors, reference=reference,
            approximate=approximate,
        )  # fmt: skip
    except Refusal as refusal:
        nan = float("nan")
        text = str(refusal)
        return Verdict(
            signal.name, Grade.NOT_WEIGHED, False, "", nan, sentence=text[:1].upper() + text[1:] + "."
        )
    found = findings(weighing, amplitudes, approximate=approximate, sensor=sensor, seed=seed)
    start = signal.provenance.get("start", 0.0)
    first = float(start) if isinstance(start, int | float) else 0.0
    t = weighing.data.t
    window = Window(first, first + float(t[-1]), weighing.data.cycles, "")
    return decide(
        found, record=signal.name, unit=signal.unit, measured=measured, approximate=approximate, window=window
    )
