"""What a user has to know of an answer on an envelope."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayesdamp.inference.envelope.decay import Decay
from bayesdamp.inference.envelope.ranking import Ranking
from bayesdamp.physics.damping import PAPER_TERMS, twins_of
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import by_ten, named


def remarks(v: Verdict, decay: Decay, ranking: Ranking, alike: Sequence[tuple[str, str]]) -> tuple[str, ...]:
    """A sentence each. alike: names of sums of which the first loses as the second does."""
    record = decay.record
    said = list(record.notes)
    if record.frequency is None:
        said.append(
            "The frequency is not known (--frequency HZ, or a line `% Frequency [Hz]: ...`): rates, but no Q."
        )
    if record.logarithmic:
        paper = all(term in PAPER_TERMS for term in ranking.terms)
        which = "Coulomb and quadratic" if paper else "all but viscous"
        said.append(f"Amplitudes have no scale: {which} coefficients are relative to that at the start.")
    for term in v.damping.split("+"):
        twins = " or ".join(named(twin) for twin in twins_of(term))
        if twins:
            said.append(
                f"An envelope cannot tell {named(term)} damping from {twins} damping, for they lose alike at every "
                f"amplitude: any part of what is called {named(term)} may be {twins}."
            )
    said += [
        f"Here {named(one)} damping loses as {named(other)} damping does at every amplitude: an envelope cannot tell "
        "them apart, and their probabilities are what was held possible before."
        for one, other in alike
    ]
    if ranking.best_exact is not ranking.best:
        said.append(
            f"If the damping followed its law exactly, {named(ranking.best_exact.name)} would be ahead."
        )
    if decay.readings < thresholds.FEW_READINGS:
        said.append(f"{decay.readings} readings only: the noise is hardly known.")
    if decay.fall < thresholds.SHALLOW:
        said.append(
            f"The level falls by {decay.fall:.1f} dB only: dampings are hardly told apart below "
            f"{thresholds.SHALLOW:g}."
        )
    if v.window is not None and not math.isfinite(v.window.floor_db):
        said.append("No noise floor is seen behind the decay: its power is inferred from the decay alone.")
    if v.power_law > thresholds.POWER_LAW and not v.decided and decay.readings >= thresholds.FEW_READINGS:
        said.append(
            "A single power law of the amplitude describes the decay better than every sum: rates are by it "
            "(--damping power, or cubic where the power is near 3, weigh it)."
        )
    stated = _stated_quality(decay)
    if stated is not None and v.quality_factor is not None:
        ours = v.quality_factor
        off = (ours.value - stated) / max(math.hypot(ours.sd_noise, ours.sd_law), 1e-300)
        side = "below" if off > 0 else "above"
        said.append(f"The file's head states Q = {by_ten(f'{stated:.4g}')}, {abs(off):.1f} sd {side} this.")
    return tuple(said)


def _stated_quality(decay: Decay) -> float | None:
    """Q as the head of the file has it."""
    facts = decay.record.facts.items()
    text = next((text for name, text in facts if name.lower().startswith("quality factor")), "")
    try:
        return float(text.split()[0])
    except (ValueError, IndexError):
        return None
