"""Answers of a comparison that stay in its folder, so that one which was cut off goes on where it was."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.envelope.asked import Asked
from bayesdamp.inference.envelope.likelihood import RateLikelihood
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import Window
from bayesdamp.sources import code_digest
from bayesdamp.store.cells import CellResult, Store
from bayesdamp.store.contents.content import Content, OtherVersionError
from bayesdamp.verdict.envelope.answer import Answer
from bayesdamp.verdict.types import Verdict

CODE = ("bayesdamp.envelope.analysis", "bayesdamp.envelope.picture")


@dataclass(frozen=True)
class EnvelopeContent(Content):
    """What is kept of one record: its answer without the curve, which only its picture needs.

    verdict: as `Verdict.to_dict` gives it. likelihoods: numbers of each, whose arrays the cell has beside.
    """

    verdict: Mapping[str, Any]
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """A record to be answered: the window that was asked for, None where it is to be found; its picture's file."""

    record: EnvelopeRecord
    window: Window | None
    picture: Path
    seed: int
    asked: Asked

    @property
    def name(self) -> str:
        """Of what is kept of it."""
        return f"envelope/of-{self.picture.stem}"

    def key(self) -> str:
        """SHA-256 of all that its answer depends on: readings, question, and the code that answers."""
        r = self.record
        found = hashlib.sha256()
        for array in (r.t, r.level):
            found.update(np.ascontiguousarray(array).tobytes())
        asked = (r.name, r.unit, r.frequency, sorted(r.facts.items()), r.notes, self.window, self.seed)
        laws = (self.asked.sums, self.asked.sources())
        found.update(repr((asked, laws, code_digest(*CODE))).encode())
        return found.hexdigest()


def kept(store: Store, task: Task) -> Answer | None:
    """The answer that is there already, with its picture; None where there is none of this very question."""
    cell = store.find(task.name)
    if cell is None or cell.key != task.key() or not task.picture.is_file():
        return None
    try:
        content = EnvelopeContent.of(cell)
    except OtherVersionError:
        return None
    own = {
        name: RateLikelihood.of(
            {key.split("/")[1]: array for key, array in cell.arrays.items() if key.split("/")[0] == name},
            numbers,
        )
        for name, numbers in content.likelihoods.items()
    }
    return Answer(Verdict.from_dict(content.verdict), likelihoods=own)


def keep(store: Store, task: Task, answer: Answer) -> None:
    """Write an answer in one step, after its picture."""
    own = answer.likelihoods
    content = EnvelopeContent(answer.verdict.to_dict(), {name: one.numbers() for name, one in own.items()})
    arrays = {f"{name}/{key}": array for name, one in own.items() for key, array in one.arrays().items()}
    store.write(CellResult(task.name, task.key(), content.meta(), arrays))
