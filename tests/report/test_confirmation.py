"""What the page says that sampling made of an answer."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

from bayesdamp.report.results.confirmation import sampled
from bayesdamp.report.results.run import Run
from bayesdamp.store import CellResult
from bayesdamp.store.contents.answers import AnswerContent
from bayesdamp.units import UNITS
from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import sentence


def cell(kind: str, damping: str) -> CellResult:
    """A stored answer: 1 % at 0.2 rad."""
    ratio = DampingRatio(0.2, "rad", 0.01, 0.0002, 0.0004, 0.009, 0.011)
    found = replace(Verdict("a", Grade.EXACT, True, damping, 0.98), damping_ratio=(ratio,))
    found = replace(found, sentence=sentence(found))
    return CellResult(f"{kind}/a/0", "key", AnswerContent(found.to_dict()).meta())


def run_of(unit: str, **dampings: str) -> Run:
    """As much of a run as is asked, with answers by kind."""
    cells = {kind: cell(kind, damping) for kind, damping in dampings.items()}
    found: Any = SimpleNamespace(
        repeats=lambda _: [0], cell=lambda kind, *_: cells.get(kind), unit=lambda _: UNITS[unit]
    )
    return cast(Run, found)


def test_what_linear_models_had_said_is_in_the_unit_of_the_record() -> None:
    said = sampled(run_of("deg", answer="viscous+stribeck", sampled="viscous+coulomb"), "a")
    assert "their linear models alone had said" in said
    assert f"at {math.degrees(0.2):.2g} deg" in said
    assert "rad" not in said
    assert "at 0.2 rad" in sampled(run_of("rad", answer="viscous+stribeck", sampled="viscous+coulomb"), "a")
    assert "confirms" in sampled(run_of("deg", answer="viscous", sampled="viscous"), "a")
