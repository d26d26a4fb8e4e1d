"""The outcome of a task, and whether a model fits: as values, and as the text of tables.

In a table an outcome is `ok`, or a sentence that begins with the words of its status. A sentence without these is a
method's own refusal. No other module writes or reads these words.
"""

from __future__ import annotations

from enum import Enum

P_LIMIT = 0.01
"""Predictive p below which, or above 1 − it, records drawn from a model look different from the record."""


class _Beginning(Enum):
    """Values are the beginnings of sentences."""

    def because(self, reason: str) -> str:
        """Return the sentence with this beginning and a reason."""
        return f"{self.value}: {reason}"


class Status(_Beginning):
    """The outcome of a task; the value is the beginning of its sentence.

    FAILED: by a fault of the program. NOT_COMPUTED: it depends on a task that failed. Both are tried again. PRUNED: a
    model of far lower evidence. NOT_SAMPLED: a model whose evidence suffices. NOT_APPLICABLE: there is nothing to infer
    from. REFUSED: a method cannot work on this record; the sentence is the reason.
    """

    OK = "ok"
    FAILED = "failed"
    NOT_COMPUTED = "not computed"
    PRUNED = "pruned"
    NOT_SAMPLED = "not sampled"
    NOT_APPLICABLE = "not applicable"
    REFUSED = ""


class Fitting(_Beginning):
    """Whether a model fits a record; the value is the beginning of its sentence."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"


def status_of(outcome: str) -> Status:
    """Return the status of an outcome."""
    if outcome == Status.OK.value:
        return Status.OK
    named = (s for s in Status if s not in (Status.OK, Status.REFUSED))
    return next((s for s in named if outcome == s.value or outcome.startswith(f"{s.value}:")), Status.REFUSED)


def fitting_of(sentence: str) -> Fitting | None:
    """Return whether a model fits, by the sentence on its fit; None where nothing was checked."""
    return next((fitting for fitting in Fitting if sentence.startswith(fitting.value)), None)


def reason_of(sentence: str) -> str:
    """Return the reason in a sentence, without the words of the status or of the fit."""
    for beginning in (*Status, *Fitting):
        if beginning.value and sentence.startswith(f"{beginning.value}:"):
            return sentence.removeprefix(f"{beginning.value}:").lstrip()
    return sentence


def following(name: str, outcome: str) -> str:
    """Return the outcome of a task that depends on another one, of this name and outcome, which is not ok.

    Where the other one failed, the outcome names it.
    """
    if status_of(outcome) is Status.FAILED:
        return Status.NOT_COMPUTED.because(f"{name} {outcome}")
    return outcome
