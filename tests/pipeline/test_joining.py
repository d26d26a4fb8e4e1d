"""The joint fit of a specimen's records, from normal likelihoods: its numbers and its sentence."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.deviation.specimen import compare_runs
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.specimens import Specimen, coefficients_of, compute_joint
from bayesdamp.report.sections.specimens import joint_sentence
from bayesdamp.store import TaskResult
from bayesdamp.types import Refusal
from tests.verdict.test_specimen import C, V, weighed_run


class StoredSpecimen(Specimen):
    """A specimen whose records have these answers."""

    deviation = "law"  # type: ignore[assignment]

    def __init__(self, *runs: Any, candidates: tuple[str, ...] = ("viscous", "coulomb")) -> None:
        names = [f"r{i}" for i in range(len(runs))]
        records = {n: SimpleNamespace(spec=SimpleNamespace(name=n), repeat=0) for n in names}
        answered = {n: SimpleNamespace(comparison=run) for n, run in zip(names, runs)}
        specs = (SimpleNamespace(parts=lambda candidate: (candidate, "linear")),)
        vars(self).update(name="rig", candidates=candidates, records=records, answered=answered, specs=specs)
        vars(self).update(seed=3, study=SimpleNamespace(priors={}))

    def units(self, candidate: object, names: Iterable[str]) -> dict[str, str]:
        return dict.fromkeys(names, "1/s")


def test_probabilities_and_spread_are_those_of_the_verdict() -> None:
    runs = [weighed_run(0.05, 0.001), weighed_run(0.052, 0.001)]
    joint, expected = compute_joint(StoredSpecimen(*runs)), compare_runs(runs, seed=3)
    content, repeats = joint.content, expected.repeats[V]
    probabilities = {name: candidate.probability for name, candidate in content.candidates.items()}
    assert probabilities == {"viscous": expected.probability[V], "coulomb": expected.probability[C]}
    assert content.spread == expected.spread()
    assert content.best == "viscous"
    assert content.candidates["viscous"].summary["zeta"]["mean"] == pytest.approx(np.mean(repeats.draws))
    assert coefficients_of(joint.arrays, "viscous")["zeta"] == pytest.approx(repeats.draws[:, 0])
    assert joint.arrays["viscous/spread"] == pytest.approx(repeats.spreads)


@pytest.mark.parametrize(
    ("ratios", "sd", "differ", "agree", "sentence"),
    [
        ((0.05, 0.05, 0.05, 0.05), 2e-5, False, True, "the records agree with one damping"),
        ((0.05, 0.052), 0.002, False, False, "the records are compatible with one damping"),
        ((0.05, 0.08), 0.001, True, False, "the records differ in the size of their damping"),
    ],
)
def test_records_agree_or_differ_according_to_their_ratios(
    ratios: tuple[float, ...], sd: float, differ: bool, agree: bool, sentence: str
) -> None:
    """Each row is the control of the others."""
    content = compute_joint(StoredSpecimen(*(weighed_run(ratio, sd) for ratio in ratios))).content
    assert (content.differ, content.agree) == (differ, agree)
    result = TaskResult("joint/rig", "", content.meta())
    assert sentence in joint_sentence(SimpleNamespace(fits=[]), result)  # type: ignore[arg-type]


def test_a_candidate_that_one_record_lacks_has_evidence_but_no_coefficients() -> None:
    runs = [weighed_run(0.05, 0.001), weighed_run(0.05, 0.001, others=())]
    del runs[1].runs[C]  # type: ignore[attr-defined]
    joint = compute_joint(StoredSpecimen(*runs, candidates=("viscous", "coulomb", "quadratic")))
    coulomb = joint.content.candidates["coulomb"]
    assert coulomb.log_evidence is not None
    assert not coulomb.summary
    assert status_of(coulomb.outcome) is Status.PRUNED
    assert joint.content.candidates["quadratic"].log_evidence is None
    assert not coefficients_of(joint.arrays, "coulomb")


def test_a_single_record_has_no_joint_fit() -> None:
    with pytest.raises(Refusal, match="fewer than two"):
        compute_joint(StoredSpecimen(weighed_run(0.05, 0.001)))
