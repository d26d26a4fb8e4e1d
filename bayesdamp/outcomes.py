"""Convert the outcome of a task, and whether a model fits, between values and the text in tables.

In a table an outcome is `ok`, or a sentence that begins with the words of its status. A sentence that does not is a
method's refusal. Only this module writes and interprets these words.
"""

from __future__ import annotations

from enum import Enum

P_LIMIT = 0.01
"""A model counts as not fitting if its posterior predictive p-value is below this (conventional). A p-value near 1 is
not a misfit: the residuals are then less autocorrelated than most white noise, because the fit absorbs a part of the
noise."""


class _Beginning(Enum):
    """Base of enumerations whose values are the beginnings of sentences."""

    def because(self, reason: str) -> str:
        """Return the sentence "VALUE: REASON", with the words of this status and a reason, such as "pruned: ..."."""
        return f"{self.value}: {reason}"


class Status(_Beginning):
    """The outcome of a task; the value is the beginning of its sentence.

    FAILED: by a fault of the program. NOT_COMPUTED: it depends on a task that failed. Both are computed again in the
    next run. PRUNED: the model has far lower evidence than others. NOT_SAMPLED: the posterior of the model, and
    results that need its draws, are left out, because the model is not among the best by evidence. NOT_APPLICABLE: the
    record has no data for the task. REFUSED: a method cannot work on this record; the sentence is the reason alone.
    """

    OK = "ok"
    FAILED = "failed"
    NOT_COMPUTED = "not computed"
    PRUNED = "pruned"
    NOT_SAMPLED = "not sampled"
    NOT_APPLICABLE = "not applicable"
    REFUSED = ""


class FitStatus(_Beginning):
    """Whether a model fits a record; the value is the beginning of the sentence on its fit."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"


def status_of(outcome: str) -> Status:
    """Return the status that an outcome's text states; `REFUSED` if it begins with the words of no other status."""
    if outcome == Status.OK.value:
        return Status.OK
    named = (s for s in Status if s not in (Status.OK, Status.REFUSED))
    return next((s for s in named if outcome == s.value or outcome.startswith(f"{s.value}:")), Status.REFUSED)


def fitting_of(sentence: str) -> FitStatus | None:
    """Return whether a model fits, according to the sentence on its fit.

    None if the sentence begins with neither value of `FitStatus`, as when nothing was checked.
    """
    return next((fitting for fitting in FitStatus if sentence.startswith(fitting.value)), None)


def reason_of(sentence: str) -> str:
    """Return a sentence without the words of `Status` or `FitStatus` at its beginning, such as "failed:".

    A sentence that does not begin with these is returned unchanged.
    """
    for beginning in (*Status, *FitStatus):
        if beginning.value and sentence.startswith(f"{beginning.value}:"):
            return sentence.removeprefix(f"{beginning.value}:").lstrip()
    return sentence


def following(name: str, outcome: str) -> str:
    """Return the outcome of a task that depends on another task whose outcome is not ok.

    name, outcome: of the other task. If that task failed, the result is "not computed" and names it; else the outcome
    is the same.
    """
    if status_of(outcome) is Status.FAILED:
        return Status.NOT_COMPUTED.because(f"{name} {outcome}")
    return outcome
