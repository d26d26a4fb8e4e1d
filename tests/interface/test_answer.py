"""The answer on records of an independent solver: the damping model is named, and intervals contain the truth."""

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.types import Signal
from bayesdamp.verdict import Verdict
from bayesdamp.verdict.parts import Grade
from validation.truth.records import Case, case

SEED = 21
NUMBERS = {0: "viscous", 4: "viscous+quadratic"}
"""Numbers of records and their damping. 97 % of such records are named correctly, and 97 to 99 % of the intervals
contain the truth: a correct program fails here for about one seed in seven. The seed was not chosen."""


@lru_cache
def answered(number: int) -> tuple[Case, Verdict]:
    record = case("family", SEED, number)
    comparison = compare_models(record.signal, restoring=[record.restoring])
    return record, answer(record.signal, comparison, record.amplitudes, measured=False).verdict


@pytest.mark.parametrize(("number", "damping"), NUMBERS.items())
def test_the_damping_is_named_and_intervals_contain_the_truth(number: int, damping: str) -> None:
    record, verdict = answered(number)
    assert record.damping == damping
    assert (verdict.damping, verdict.decided) == (damping, True)
    assert verdict.probability > 0.95
    assert verdict.grade in (Grade.EXACT, Grade.APPROXIMATE)
    assert tuple(r.amplitude for r in verdict.damping_ratio) == record.amplitudes
    for ratio in verdict.damping_ratio:
        truth = record.ratio(ratio.amplitude)
        assert ratio.low < truth < ratio.high
        assert (ratio.high - ratio.low) / truth < 0.4
        assert not ratio.low < 1.3 * truth < ratio.high  # control
    for share in verdict.energy:
        assert share.low <= record.shares.get(share.term, 0.0) + 0.02
        assert share.high >= record.shares.get(share.term, 0.0) - 0.02
    assert verdict.sentence


def test_a_wrong_damping_model_alone_is_not_the_answer() -> None:
    """Control of the test above: the true term is not compared, and a power of the velocity, with the true term's
    exponent, describes the record."""
    record = case("family", SEED, 1)
    assert record.damping == "coulomb"
    comparison = compare_models(record.signal, damping=["viscous"], restoring=[record.restoring])
    verdict = answer(record.signal, comparison, record.amplitudes).verdict
    assert verdict.damping == "viscous"
    assert not verdict.decided
    assert verdict.rivals[0].damping == "power"
    assert verdict.rivals[0].probability > 0.95
    assert abs(verdict.exponent.value) < 0.1
    for ratio in verdict.damping_ratio:
        assert ratio.value == pytest.approx(record.ratio(ratio.amplitude), rel=0.05)


def test_a_record_without_an_oscillation_has_a_verdict() -> None:
    signal = Signal(np.arange(400) * 0.01, np.random.default_rng(2).standard_normal(400), name="silence")
    verdict = answer(signal, compare_models(signal)).verdict
    assert (verdict.grade, verdict.decided, verdict.damping) == (Grade.NOT_WEIGHED, False, "")
    assert verdict.record == "silence"
    assert verdict.sentence[0].isupper()
    assert verdict.sentence.endswith(".")
