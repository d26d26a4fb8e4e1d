"""A result in one sentence, and what else a user has to know of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayesdamp.envelope.records.record import EnvelopeRecord
from bayesdamp.envelope.results import EnvelopeResult, Estimated

TERMS = {"viscous": "viscous", "coulomb": "Coulomb", "quadratic": "quadratic"}
CAP = 0.99
"""What is claimed of a measured record at most: statements at more were not right as often."""
ORDER = (1, 0, 2)
"""Power of the velocity of each term."""
NEAR, NARROW = 0.02, 0.6
"""How far outside of an exponent's interval a law may be and is named, and how wide the interval may be."""
FEW = 20
SHALLOW = 10.0
"""dB of fall below which sums of dampings are hardly told apart."""
TWIN = (
    "Structural (rate independent) damping loses as viscous damping does at every amplitude: an envelope cannot tell "
    "them apart, and any part of what is called viscous may be structural."
)
Pairs = Sequence[tuple[str, str]]
"""Of names of sums."""
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def damping_words(name: str) -> str:
    """`viscous+coulomb` as viscous + Coulomb."""
    return " + ".join(TERMS.get(term) or _registered(term) for term in name.split("+"))


def _twin(term: str) -> str:
    """What is said of a term that loses as another does."""
    if term in TERMS:
        return TWIN if term == "viscous" else ""
    from bayesdamp.physics.damping import twins_of

    names = [damping_words(name) for name in twins_of(term)]
    return (
        f"{noun_of(term)} loses as {' and '.join(names)} does at every amplitude: an envelope cannot tell them apart."
        if names
        else ""
    )


def _registered(term: str) -> str:
    from bayesdamp.physics.damping import words_of  # imports slowly; most envelopes need none of it

    return words_of(term)


def noun_of(name: str) -> str:
    """A sum with `damping` behind it, where its words have no noun of their own."""
    words = damping_words(name)
    return words if words.endswith("friction") else f"{words} damping"


def probability_words(value: float) -> str:
    """A probability with two digits, never above the cap of what is claimed."""
    return f"{min(value, CAP):.2f}"


def number(value: float, digits: int = 4) -> str:
    """A number to so many significant digits, with a power of ten where it is far from 1."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    power = int(f"{value:.{digits - 1}e}".split("e")[1])
    if -3 <= power < 5:
        return f"{value:.{max(0, digits - 1 - power)}f}"
    return f"{value / 10.0**power:.{digits - 1}f} × 10{str(power).translate(_RAISED)}"


def with_interval(found: Estimated, unit: str = "") -> str:
    """value ± sd in per cent, and the interval."""
    sd = math.hypot(found.sd_noise, found.sd_law)
    share = 100.0 * sd / abs(found.value) if found.value else math.nan
    behind = f" {unit}" if unit else ""
    return (
        f"{number(found.value)}{behind} ± {share:.2g} % (95 %: {number(found.low)} to {number(found.high)})"
    )


def no_decay(name: str, why: str) -> str:
    """The sentence on a record without a free decay."""
    return f"{name}: no free decay: {why}."


def sentence(found: EnvelopeResult, alike: Pairs = ()) -> str:
    """The answer first: Q or the rate, then which damping, then the exponent and how exactly the law holds.

    alike: sums of which the first loses as the second does, so that nothing tells the most probable one from the other.
    """
    assert found.rate is not None
    if found.quality_factor is not None:
        head = f"Q = {with_interval(found.quality_factor)}"
    else:
        head = f"decay rate {with_interval(found.rate, '1/s')}"
    parts = [f"{found.name}: {head}", _which(found, alike)]
    if found.exponent is not None:
        p = found.exponent
        value, low, high = (f"{one:.{_places(p.high - p.low)}f}" for one in (p.value, p.low, p.high))
        parts.append(f"it loses like v^{value} (95 %: {low} to {high}){_kind(p.low, p.high)}")
    if found.deviation is not None and found.probability_exact < 0.5:
        d = found.deviation
        parts.append(
            f"the rate departs from that law by {100 * d.value:.2g} % ({100 * d.low:.2g} to {100 * d.high:.2g})"
        )
    return "; ".join(parts) + "."


def _places(width: float) -> int:
    """Decimals of an exponent with an interval of this width: two, or what shows a third of it."""
    return min(max(2, -math.floor(math.log10(width / 3))), 6) if width > 0 else 2


def _kind(low: float, high: float) -> str:
    """Which of the three laws an exponent's interval holds."""
    held = [name for power, name in enumerate(TERMS.values()) if low - NEAR <= ORDER[power] <= high + NEAR]
    return f": {held[0]}" if len(held) == 1 and high - low <= NARROW else ""


def _which(found: EnvelopeResult, alike: Pairs) -> str:
    said = f"{noun_of(found.damping)} (probability {probability_words(found.probability)})"
    if found.decided:
        return said
    twins = {name for pair in alike for name in pair}
    left = {name: p for name, p in found.probabilities.items() if name == found.damping or name not in twins}
    ranked = sorted(left.items(), key=lambda one: -one[1])
    others = [f"{damping_words(name)} {p:.2f}" for name, p in ranked[1:3] if p >= 0.02]
    against = f", against {' and '.join(others)}" if others else ""
    if found.grade == "deviates":
        usual = all(term in TERMS for term in found.terms)
        none = "no sum of viscous, Coulomb and quadratic damping" if usual else "none of the dampings weighed"
        return f"{none} describes it well, {said} best{against}"
    if alike:
        other = next(one for one in alike[0] if one != found.damping)
        rival = f"{noun_of(other)} ({found.probabilities[other]:.2f}), which loses alike"
        return f"which damping is not decided: {said}, or {rival}{against}"
    if found.probability > 0.95:
        return f"most likely {said}, but not decided: an exact law would have another"
    return f"which damping is not decided: most likely {said}{against}"


def remarks(
    found: EnvelopeResult, record: EnvelopeRecord, readings: int, fall: float, alike: Pairs = ()
) -> tuple[str, ...]:
    """What a user has to know. readings: in the decay; fall: dB; alike: see `sentence`."""
    said = list(record.notes)
    if record.frequency is None:
        said.append(
            "The frequency is not known (--frequency HZ, or a line `% Frequency [Hz]: ...`): rates, but no Q."
        )
    if record.logarithmic:
        which = "Coulomb and quadratic" if all(term in TERMS for term in found.terms) else "all but viscous"
        said.append(f"Amplitudes have no scale: {which} coefficients are relative to that at the start.")
    said += [twin for term in found.damping.split("+") if (twin := _twin(term))]
    said += [
        f"Here {noun_of(one)} loses as {noun_of(other)} does at every amplitude: an envelope cannot tell "
        "them apart, and their probabilities are what was held possible before."
        for one, other in alike
    ]
    if readings < FEW:
        said.append(f"{readings} readings only: the noise is hardly known.")
    if fall < SHALLOW:
        said.append(
            f"The level falls by {fall:.1f} dB only: dampings are hardly told apart below {SHALLOW:g}."
        )
    if found.cut is not None and not math.isfinite(found.cut.floor):
        said.append("No noise floor is seen behind the decay: its power is inferred from the decay alone.")
    if found.power_law > math.log(20.0) and not found.decided and readings >= FEW:
        said.append(
            "A single power law of the amplitude describes the decay better than every sum: rates are by it "
            "(--damping power, or cubic where the power is near 3, weigh it)."
        )
    stated = next(
        (text for name, text in record.facts.items() if name.lower().startswith("quality factor")), None
    )
    if stated is not None and found.quality_factor is not None:
        try:
            q = float(stated.split()[0])
        except ValueError:
            return tuple(said)
        ours = found.quality_factor
        off = (ours.value - q) / max(math.hypot(ours.sd_noise, ours.sd_law), 1e-300)
        said.append(
            f"The file's head states Q = {number(q)}, {abs(off):.1f} sd {'below' if off > 0 else 'above'} this."
        )
    return tuple(said)
