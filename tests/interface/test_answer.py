"""The answer to simulated records of another solver: the damping by its name, intervals that hold the truth."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict import Verdict
from bayesdamp.verdict.parts import Grade
from validation.truth.records import Case, case

SEED = 21
NUMBERS = {0: "viscous", 4: "viscous+quadratic"}
"""Of such records 97 % are named right where one is named, and an interval holds the truth in 97 to 99 %: of two
records and their six ratios a right program fails here for about one seed in seven. The seed was not chosen."""


@lru_cache
def answered(number: int) -> tuple[Case, Verdict]:
    made = case("family", SEED, number)
    return made, answer(made.signal, made.amplitudes, restoring=[made.restoring], measured=False).verdict


@pytest.mark.parametrize(("number", "damping"), NUMBERS.items())
def test_named_right_with_intervals_that_hold_the_truth(number: int, damping: str) -> None:
    made, found = answered(number)
    assert made.damping == damping
    assert (found.damping, found.decided) == (damping, True)
    assert found.probability > 0.95
    assert found.grade in (Grade.EXACT, Grade.APPROXIMATE)
    assert tuple(r.amplitude for r in found.damping_ratio) == made.amplitudes
    for ratio in found.damping_ratio:
        truth = made.ratio(ratio.amplitude)
        assert ratio.low < truth < ratio.high
        assert (ratio.high - ratio.low) / truth < 0.4
        assert not ratio.low < 1.3 * truth < ratio.high  # control
    for share in found.energy:
        assert share.low <= made.shares.get(share.term, 0.0) + 0.02
        assert share.high >= made.shares.get(share.term, 0.0) - 0.02
    assert found.sentence


def test_the_wrong_law_alone_is_not_the_answer() -> None:
    """Control: offered only the one term that a record lacks, nothing is decided, and a power of the velocity, which is
    the true term's, is what describes it."""
    made, wrong = case("family", SEED, 1), "viscous"
    assert made.damping == "coulomb"
    found = answer(made.signal, made.amplitudes, damping=[wrong], restoring=[made.restoring]).verdict
    assert found.damping == wrong
    assert not found.decided
    assert found.rivals[0].damping == "power"
    assert found.rivals[0].probability > 0.95
    assert abs(found.exponent.value) < 0.1
    for at in found.damping_ratio:
        assert at.value == pytest.approx(made.ratio(at.amplitude), rel=0.05)


def test_what_does_not_oscillate_has_a_sentence() -> None:
    noise = np.random.default_rng(2).standard_normal(400)
    found = answer(Signal(np.arange(400) * 0.01, noise, name="silence")).verdict
    assert found.grade is Grade.NOT_WEIGHED
    assert not found.decided
    assert found.damping == ""
    assert found.record == "silence"
    assert found.sentence[0].isupper()
    assert found.sentence.endswith(".")


def test_motions_are_sampled_of_the_weighing_that_was_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """The answer from linear models first: it is weighed once, and what follows is what one call would say."""
    made, _ = answered(0)
    sums, laws = ["viscous", "coulomb"], [made.restoring]
    whole = answer(made.signal, made.amplitudes, damping=sums, restoring=laws).verdict
    kept: dict[str, ModelComparison] = {}
    answer(made.signal, made.amplitudes, damping=sums, restoring=laws, sample=False, comparisons=kept)
    monkeypatch.setattr("bayesdamp.interface.answer.compare_signal", None)  # nothing weighs again
    after = answer(made.signal, made.amplitudes, damping=sums, restoring=laws, comparisons=kept).verdict
    assert after == whole
    with pytest.raises(TypeError):  # control
        answer(made.signal, made.amplitudes, damping=sums, restoring=laws)
