"""Today's answers on a few of the fixed records are those that were frozen; `python -m tests.reference.frozen compare`
takes all of them."""

from __future__ import annotations

import copy

import pytest

from tests.reference.frozen import answered, differences, envelope_row, frozen, simulated


@pytest.mark.parametrize("name", ["sum-003", "cubic-1"])
def test_an_answer_is_as_it_was(name: str) -> None:
    assert differences(frozen("simulated")[name]["quick"], answered(simulated(name), sample=False)) == []


def test_an_envelope_s_answer_is_as_it_was() -> None:
    before, now = frozen("envelopes")["ringdown-03"], envelope_row("ringdown-03")
    assert differences(before["quick"], now["quick"]) == []


def test_what_moves_is_said() -> None:
    """Negative control: another lead, an end of an interval, evidence, and a candidate that is gone."""
    before = frozen("simulated")["sum-003"]["quick"]
    for change, said in (
        (lambda a: a.update(damping="quadratic"), "damping"),
        (lambda a: a["ratios"][0].__setitem__(2, 0.9 * a["ratios"][0][2]), "of its width"),
        (
            lambda a: a["evidence"].update({n: v - 0.1 for n, v in list(a["evidence"].items())[1:2]}),
            "evidence of",
        ),
        (lambda a: a["evidence"].pop(next(iter(a["evidence"]))), "no longer weighed"),
    ):
        now = copy.deepcopy(before)
        change(now)
        assert said in " ".join(differences(before, now))
    assert differences(before, copy.deepcopy(before)) == []
