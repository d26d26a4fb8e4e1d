"""Several restoring laws in one study: a candidate is a damping model under a law."""

import json
import math
from dataclasses import replace
from itertools import product
from types import SimpleNamespace
from typing import cast

import pytest

from bayesdamp.inference.deviation.model_comparison import FAR_BEHIND
from bayesdamp.pipeline import tables
from bayesdamp.pipeline.answering import stored_fit
from bayesdamp.pipeline.jobs import choose_candidates
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.pipeline.run import run_study
from bayesdamp.store.files import read_table
from bayesdamp.store.results import AnswerContent, ComparedCandidate, Store, TaskResult
from bayesdamp.types import Evidence, Refusal, Status, status_of
from tests.studies import ESTIMATED, WEIGHED, study_text, write_study

LAWS = ("linear", "duffing")
TWO_LAWS = study_text(
    ESTIMATED,
    'models = { compare = ["viscous", "coulomb"], restoring = ["linear", "duffing"] }',
    "posterior = { samplers = [] }\nevidence = { methods = [] }",
    simulate="viscous = 0.05, coulomb = 0.02, duration = 6.0, samples = 300, rest_angle = 0.0, noise_sd = 0.0",
    name="swing",
    system='restoring = "linear", stiffness = 20.0, cubic = 1.0, theta0 = 0.3, omega0 = 0.0, epsilon = 0.05',
)


def test_every_damping_is_fitted_under_every_law_with_its_own_known_parameters(tmp_path) -> None:
    study = write_study(tmp_path, TWO_LAWS)
    spec = study.signals[0]
    known = {law: (spec.under(law).known["stiffness"], spec.under(law).known.get("cubic")) for law in LAWS}
    assert known == {"linear": (20.0, None), "duffing": (20.0, 1.0)}
    assert run_study(study, tmp_path / "out", workers=1) == 0
    rows = read_table(tmp_path / "out" / "estimates.csv")
    parameters = {(r["model"], r["restoring"], r["parameter"]) for r in rows}
    assert {p[:2] for p in parameters} == set(product(("viscous", "coulomb"), LAWS))
    assert {("viscous", "duffing", "zeta"), ("viscous", "duffing", "rest_angle")} <= parameters
    for r in rows:  # parameters of a law that the record does not have are without a truth
        other = r["restoring"] == "duffing" and r["parameter"] in ("stiffness", "rest_angle", "cubic")
        assert math.isnan(r["truth"]) == other, r
    signal = json.loads((tmp_path / "out" / "run.json").read_text())["signals"]["swing"]
    assert signal["restoring"] == ["linear", "duffing"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "viscous (Duffing)" in page
    assert "viscous (linear)" in page


def test_probabilities_are_shared_by_the_candidates_with_evidence(tmp_path, monkeypatch) -> None:
    """The two candidates with evidence have odds of e², a pruned one has 0, and one that failed has none. Control: a
    method that is not yet computed for a candidate gives no probabilities."""
    study, nan = write_study(tmp_path, TWO_LAWS), math.nan
    names = study.compare(study.signals[0])

    def evidence_of(method: str, *logs: float) -> dict[str, Evidence]:
        outcomes = ["ok" if math.isfinite(log) else "the posterior has two modes" for log in logs]
        evidence = {n: Evidence(n, method, log, 0.01, outcome=o) for n, log, o in zip(names, logs, outcomes)}
        return evidence | {names[3]: Evidence(names[3], method, outcome="pruned: far behind")}

    logs = {"importance": (-5.0, -7.0, nan), "bridge": (-5.0, nan, nan)}
    methods = {method: evidence_of(method, *of_models) for method, of_models in logs.items()}
    methods["bridge"][names[1]] = Evidence(names[1], "bridge", outcome="no draws")
    monkeypatch.setattr(tables, "evidence_by_method", lambda *_: methods)
    rows = list(tables._evidence(study, Store(tmp_path / "run")))
    shares = {(r["method"], r["model"], r["restoring"]): r["probability"] for r in rows}
    first = 1 / (1 + math.exp(-2.0))
    assert shares["importance", "viscous", "linear"] == pytest.approx(first)
    assert shares["importance", "viscous", "duffing"] == pytest.approx(1 - first)
    assert math.isnan(shares["importance", "coulomb", "linear"])
    assert shares["importance", "coulomb", "duffing"] == 0.0
    assert math.isnan(shares["bridge", "viscous", "linear"])


def test_candidates_are_pruned_and_sampled_by_the_evidence_of_the_answer(tmp_path) -> None:
    """On a record with viscous damping, quadratic damping is far behind; of the other two, the best one is sampled.

    A run without these limits samples them all; with the limits, its results no longer count. A candidate at the limit
    is pruned too.
    """
    text = study_text(
        ESTIMATED,
        'models = { compare = ["viscous", "quadratic", "viscous+quadratic"] }',
        WEIGHED.replace("[]", '["nuts"]').replace("'laplace'", "'importance', 'bridge'"),
        simulate="viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003",
    )
    every, out = write_study(tmp_path, text), tmp_path / "out"
    assert run_study(every, out, workers=1) == 0
    record = StudyRecord(every, every.signals[0], 0, Store(out))
    assert choose_candidates(record) == (every.compare(record.spec),) * 2
    limited = text.replace('+quadratic"] }', '+quadratic"], prune = 50.0 }')
    study = write_study(tmp_path, limited.replace('["nuts"]', '["nuts"], best = 1'))
    assert run_study(study, out, workers=1) == 0
    rows = {(r["model"], r["method"]): r["outcome"] for r in read_table(out / "evidence.csv")}
    assert rows["viscous", "bridge"] == rows["viscous+quadratic", "importance"] == "ok"
    assert status_of(rows["viscous+quadratic", "bridge"]) is Status.NOT_SAMPLED
    assert {status_of(rows["quadratic", m]) for m in ("importance", "bridge")} == {Status.PRUNED}
    drawn = (r for r in read_table(out / "posteriors.csv") if r["outcome"] == "ok")
    assert {r["model"] for r in drawn if r["sampler"] == "nuts"} == {"viscous"}
    logs = {c.damping: c.exact for c in AnswerContent.of(Store(out).read("answer/rig/0")).candidates}

    def kept(prune: float) -> tuple[str, ...]:
        other = replace(study, models=study.models.model_copy(update={"prune": prune}))
        return tuple(choose_candidates(StudyRecord(other, study.signals[0], 0, Store(out)))[0])

    behind = logs["viscous"] - logs["viscous+quadratic"]
    assert kept(behind) == ("viscous",)
    assert kept(behind * 1.001) == ("viscous", "viscous+quadratic")


def test_a_candidate_that_the_answer_left_out_as_far_behind_is_pruned() -> None:
    """So its evidence is not an unreliable one, and its probability is 0."""
    left_out = (("coulomb", FAR_BEHIND), ("quadratic", "no motion stays in phase"))
    candidates = tuple(ComparedCandidate(damping, "linear", outcome=why) for damping, why in left_out)
    result = TaskResult("answer/a/0", "key", AnswerContent({}, candidates).meta())
    record = cast(StudyRecord, SimpleNamespace(name="a/0", store=SimpleNamespace(read=lambda _: result)))
    for (damping, _), status in zip(left_out, (Status.PRUNED, Status.REFUSED), strict=True):
        with pytest.raises(Refusal) as refusal:
            stored_fit(record, damping, "linear")
        assert status_of(str(refusal.value)) is status
