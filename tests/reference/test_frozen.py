"""The answers on three fixed records are the stored ones. `python -m validation.frozen compare` checks all."""

import copy

import pytest

from validation.frozen import answered, differences, envelope_row, simulated, stored


@pytest.mark.parametrize("name", ["sum-003", "cubic-1"])
def test_an_answer_has_not_changed(name: str) -> None:
    assert differences(stored("simulated")[name]["quick"], answered(simulated(name))) == []


def test_the_answer_on_an_envelope_has_not_changed() -> None:
    before, now = stored("envelopes")["ringdown-03"], envelope_row("ringdown-03")
    assert differences(before["quick"], now["quick"]) == []


def test_changes_are_reported() -> None:
    """Negative control: another damping, end of an interval and evidence, and a missing candidate."""
    before = stored("simulated")["sum-003"]["quick"]
    second = list(before["evidence"])[1]
    for change, words in (
        (lambda a: a.update(damping="quadratic"), "damping"),
        (lambda a: a["ratios"][0].__setitem__(2, 0.9 * a["ratios"][0][2]), "of its width"),
        (lambda a: a["evidence"].update({second: a["evidence"][second] - 0.1}), "evidence of"),
        (lambda a: a["evidence"].pop(second), "no longer compared"),
    ):
        now = copy.deepcopy(before)
        change(now)
        assert words in " ".join(differences(before, now))
    assert differences(before, copy.deepcopy(before)) == []
