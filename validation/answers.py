"""Compare the answer on a simulated record with its truth, as a row of a table."""

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
"""Largest relative difference between the amplitude of a damping ratio and the requested amplitude."""
LEAST = 1e-12
"""Smaller probabilities count as this value, so that the mean of their logarithms is finite."""


Answering = Callable[[Signal, tuple[float, ...]], Verdict]
"""A function of a record and three amplitudes (rad) that returns a verdict, or raises Refusal if it has none.

A verdict without damping ratios counts as no answer; its sentence gives the reason.
"""
COLUMNS = (
    "case", "kind", "oversample", "mode", "damping", "restoring", "cycles", "nats", "noise_sd", "outcome", "seconds",
    "decided", "named", "relation", "probability", "true_probability", "grade",
    *(f"{what}_{i}" for i in (1, 2, 3) for what in ("amplitude", "ratio", "value", "low", "high")),
    "deviation", "deviation_low", "deviation_high",
)  # fmt: skip

Row = dict[str, Any]


def row_of(case: Case, answering: Answering, mode: str) -> Row:
    """Answer a record, and return a row with the answer and the truth.

    Parameters
    ----------
    case : Case
        The record and its truth.
    answering : callable
        Function that returns the verdict on the record.
    mode : str
        How the answer was requested, such as "none" or "auto". The row uses it as a label.

    Returns
    -------
    dict
        Values of `COLUMNS`. After a refusal, the outcome is the text of the refusal.

    Raises
    ------
    ValueError
        The answer gives a damping ratio at an amplitude that was not requested.
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
    for i, (requested, at) in enumerate(zip(case.amplitudes, answer.damping_ratio, strict=True), 1):
        if not math.isclose(at.amplitude, requested, rel_tol=NEAR):
            raise ValueError(
                f"{case.name}: the damping ratio is at {at.amplitude:g} rad, but {requested:g} rad was requested"
            )
        # A ratio that is measured without a law may be at a slightly different amplitude.
        row |= {f"amplitude_{i}": at.amplitude, f"ratio_{i}": case.ratio(at.amplitude)}
        row |= {f"value_{i}": at.value, f"low_{i}": at.low, f"high_{i}": at.high}
    if answer.deviation is not None:
        deviation = answer.deviation
        row |= {
            "deviation": deviation.value, "deviation_low": deviation.low, "deviation_high": deviation.high,
        }  # fmt: skip
    return row


def relation(named: str, truth: str) -> str:
    """Return "right", "more" (further terms), "less" (missing terms) or "other" for a named damping sum."""
    claimed, true = set(named.split("+")), set(truth.split("+"))
    if claimed == true:
        return "right"
    return "more" if claimed > true else "less" if claimed < true else "other"


def probability_of(answer: Verdict, damping: str) -> float:
    """Return the probability that an answer gives to a damping sum.

    The sums that the answer does not list share the remaining probability equally.
    """
    listed = {frozenset(answer.damping.split("+")): float(answer.probability)}
    for rival in answer.rivals:
        listed.setdefault(frozenset(rival.damping.split("+")), float(rival.probability))
    wanted = frozenset(damping.split("+"))
    if wanted in listed:
        return listed[wanted]
    unlisted = sum(frozenset(name.split("+")) not in listed for name in SUMS)
    return max(1.0 - sum(listed.values()), 0.0) / max(unlisted, 1)
