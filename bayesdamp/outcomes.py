"""What became of a task, and whether a model fits: values, and the only place that writes and reads how tables say it.

A table holds an outcome as text: `ok`, or a sentence that begins with the words of its status where it has one. A
sentence without is a method's own refusal.
"""

from __future__ import annotations

from enum import Enum

_BETWEEN = ": "
P_LIMIT = 0.01
"""Predictive p below which, and above one less it, records drawn from a model look different from the record."""


class _Beginning(Enum):
    """A value is how a sentence begins."""

    def because(self, reason: str) -> str:
        """Return the sentence that says this and why."""
        return f"{self.value}{_BETWEEN}{reason}"


class Status(_Beginning):
    """What became of a task; the value is how its outcome begins.

    FAILED: by a fault of the program; NOT_COMPUTED: it depends on one that failed; both are tried again. PRUNED: a
    model far behind; NOT_SAMPLED: one whose evidence is enough; NOT_APPLICABLE: nothing to infer from; REFUSED: a
    method cannot work on this record, and says why.
    """

    OK = "ok"
    FAILED = "failed"
    NOT_COMPUTED = "not computed"
    PRUNED = "pruned"
    NOT_SAMPLED = "not sampled"
    NOT_APPLICABLE = "not applicable"
    REFUSED = ""


class Fitting(_Beginning):
    """Whether a model fits a record; the value is how its sentence begins."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"


def status_of(outcome: str) -> Status:
    """The status that an outcome tells."""
    if outcome == Status.OK.value:
        return Status.OK
    named = (s for s in Status if s not in (Status.OK, Status.REFUSED))
    return next((s for s in named if outcome == s.value or outcome.startswith(f"{s.value}:")), Status.REFUSED)


def fitting_of(sentence: str) -> Fitting | None:
    """Whether a model fits, by the sentence on its fit; None where nothing was checked."""
    return next((one for one in Fitting if sentence.startswith(one.value)), None)


def reason_of(said: str) -> str:
    """Why, without the words of the status or of the fit."""
    for one in (*Status, *Fitting):
        if one.value and said.startswith(f"{one.value}:"):
            return said.removeprefix(f"{one.value}:").lstrip()
    return said


def following(name: str, outcome: str) -> str:
    """The outcome of what depends on a task with this name and outcome, which is not ok: where it failed, this says
    which one."""
    if status_of(outcome) is Status.FAILED:
        return Status.NOT_COMPUTED.because(f"{name} {outcome}")
    return outcome
