"""What the joint fit of a specimen says: of hand-made normal likelihoods, and in words."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.deviation.specimen import compare_runs
from bayesdamp.outcomes import Status, status_of
from bayesdamp.pipeline.specimens import (
    Specimen,
    coefficients_of,
    compute_joint,
)
from bayesdamp.report.sections.specimens import joint_sentence
from bayesdamp.store import TaskResult
from bayesdamp.types import Refusal
from tests.verdict.test_specimen import C, V, weighed_run


class Joined(Specimen):
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
    product = compute_joint(Joined(*runs))
    content, arrays = product.content, product.arrays
    whole = compare_runs(runs, seed=3)
    assert {c: r.probability for c, r in content.candidates.items()} == {
        "viscous": whole.probability[V], "coulomb": whole.probability[C]
    }  # fmt: skip
    assert content.spread == whole.spread()
    assert content.best == "viscous"
    row = content.candidates["viscous"].summary["zeta"]
    assert row["mean"] == pytest.approx(np.mean(whole.repeats[V].draws))
    assert coefficients_of(arrays, "viscous")["zeta"] == pytest.approx(whole.repeats[V].draws[:, 0])
    assert arrays["viscous/spread"] == pytest.approx(whole.repeats[V].spreads)


@pytest.mark.parametrize(
    ("places", "sd", "differ", "agree", "said"),
    [
        ((0.05, 0.05, 0.05, 0.05), 2e-5, False, True, "the records agree with one damping"),
        ((0.05, 0.052), 0.002, False, False, "the records are compatible with one damping"),
        ((0.05, 0.08), 0.001, True, False, "the records differ in the size of their damping"),
    ],
)
def test_whether_records_agree(
    places: tuple[float, ...], sd: float, differ: bool, agree: bool, said: str
) -> None:
    """Each row is the control of the others."""
    content = compute_joint(Joined(*(weighed_run(p, sd) for p in places))).content
    assert (content.differ, content.agree) == (differ, agree)
    sentence = joint_sentence(SimpleNamespace(fits=[]), TaskResult("joint/rig", "", content.meta()))  # type: ignore[arg-type]
    assert said in sentence


def test_a_candidate_that_a_record_lacks_has_evidence_and_no_coefficients() -> None:
    runs = [weighed_run(0.05, 0.001), weighed_run(0.05, 0.001, others=())]
    del runs[1].runs[C]  # type: ignore[attr-defined]
    product = compute_joint(Joined(*runs, candidates=("viscous", "coulomb", "quadratic")))
    content, arrays = product.content, product.arrays
    assert content.candidates["coulomb"].log_evidence is not None
    assert not content.candidates["coulomb"].summary
    assert status_of(content.candidates["coulomb"].outcome) is Status.PRUNED
    assert content.candidates["quadratic"].log_evidence is None
    assert not coefficients_of(arrays, "coulomb")


def test_one_answer_is_not_enough() -> None:
    with pytest.raises(Refusal, match="fewer than two"):
        compute_joint(Joined(weighed_run(0.05, 0.001)))
