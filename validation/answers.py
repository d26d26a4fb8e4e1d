"""The row of a case: its truth, and the answer that a record got."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

from bayesdamp.types import OK, Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.truth.oscillator import SUMS
from validation.truth.records import Case

NEAR = 0.1
"""How far, as a share, the amplitude of a damping ratio may be from the one that was asked for."""
LEAST = 1e-12
"""Probabilities below count as this, so that a mean of their logarithms is finite."""


Answering = Callable[[Signal, tuple[float, ...]], Verdict]
"""From a record and three amplitudes (rad) to a verdict. Raises Refusal if there is none.

A verdict without damping ratios has no answer; its sentence says why.
"""
COLUMNS = (
    "case", "kind", "oversample", "mode", "damping", "restoring", "cycles", "nats", "noise_sd", "outcome", "seconds",
    "decided", "named", "relation", "probability", "true_probability", "grade",
    *(f"{what}_{i}" for i in (1, 2, 3) for what in ("amplitude", "ratio", "value", "low", "high")),
    "deviation", "deviation_low", "deviation_high",
)  # fmt: skip

Row = dict[str, Any]


def row_of(case: Case, answering: Answering, mode: str) -> Row:
    """The row of a case: its truth, and what an answer says.

    mode: how the answer was asked for, such as "none" or "auto"; kept as a label. A refusal is kept as the outcome.
    """
    row: Row = {
        "case": case.name, "kind": case.kind, "oversample": case.oversample, "mode": mode, "damping": case.damping,
        "restoring": case.restoring, "cycles": case.cycles, "nats": case.nats, "noise_sd": case.noise_sd,
    }  # fmt: skip
    for i, amplitude in enumerate(case.amplitudes, 1):
        row |= {f"amplitude_{i}": amplitude, f"ratio_{i}": case.ratio(amplitude)}
    began = time.perf_counter()
    try:
        answer = answering(case.signal, case.amplitudes)
    except Refusal as refusal:
        return row | {"outcome": str(refusal), "seconds": time.perf_counter() - began, "decided": False}
    if not answer.damping_ratio:
        return row | {"outcome": answer.sentence, "seconds": time.perf_counter() - began, "decided": False}
    row |= {"outcome": OK, "seconds": time.perf_counter() - began, "decided": bool(answer.decided)}
    row |= {
        "named": answer.damping, "relation": relation(answer.damping, case.damping),
        "probability": answer.probability, "true_probability": probability_of(answer, case.damping),
        "grade": str(answer.grade),
    }  # fmt: skip
    for i, (asked, at) in enumerate(zip(case.amplitudes, answer.damping_ratio, strict=True), 1):
        if not math.isclose(at.amplitude, asked, rel_tol=NEAR):
            raise ValueError(f"{case.name}: a damping ratio at {at.amplitude:g} rad, asked was {asked:g} rad")
        # What is measured without a law ends within the record's amplitudes: compare with the truth where it is given.
        row |= {f"amplitude_{i}": at.amplitude, f"ratio_{i}": case.ratio(at.amplitude)}
        row |= {f"value_{i}": at.value, f"low_{i}": at.low, f"high_{i}": at.high}
    if answer.deviation is not None:
        found = answer.deviation
        row |= {"deviation": found.value, "deviation_low": found.low, "deviation_high": found.high}
    return row


def relation(named: str, truth: str) -> str:
    """How a named damping sum differs from the true one: right, or which terms are "more", "less" or "other"."""
    said, true = set(named.split("+")), set(truth.split("+"))
    if said == true:
        return "right"
    return "more" if said > true else "less" if said < true else "other"


def probability_of(answer: Verdict, damping: str) -> float:
    """The probability that an answer gives to a damping sum.

    What neither the named sum nor the rivals take is shared evenly by the sums that are not listed.
    """
    listed = {frozenset(answer.damping.split("+")): float(answer.probability)}
    for rival in answer.rivals:
        listed.setdefault(frozenset(rival.damping.split("+")), float(rival.probability))
    wanted = frozenset(damping.split("+"))
    if wanted in listed:
        return listed[wanted]
    unlisted = sum(frozenset(name.split("+")) not in listed for name in SUMS)
    return max(1.0 - sum(listed.values()), 0.0) / max(unlisted, 1)
