"""The evidence for parts of a record and under other noise models."""

from __future__ import annotations

import pytest

from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.search import find_mode
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store
from tests.studies import COMPARED, study_text, write_study

STUDY = study_text(
    'estimators = { use = ["least_squares"] }',
    COMPARED,
    'posterior = { samplers = [], noise = ["gaussian", "student_t"] }',
    'evidence = { methods = ["importance"], referee = "never" }',
    simulate="viscous = 0.08, stiffness = 20, theta0 = 0.3, omega0 = 0, duration = 12, samples = 300, noise_sd = 6e-3",
    name="noisy",
    system='restoring = "linear", stiffness = "free", rest_angle = 0.0, theta0 = "free", omega0 = "free"',
)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("elsewhere")
    study = write_study(folder, STUDY)
    assert run_study(study, folder / "out", workers=1) == 0
    return study, Store(folder / "out")


def evidence_of(store: Store, name: str) -> float:
    meta = store.read(name).meta
    return meta.get("evidence", meta)["log_evidence"]


def test_the_evidence_of_parts_of_the_record_is_that_of_importance_sampling(run):
    """That of the first half to a tenth of a nat. Control: that of the other model."""
    _, store = run
    halves: dict[str, list[float]] = {}
    for model in ("viscous", "quadratic"):
        windows = {w["label"]: w["log_evidence"] for w in store.read(f"mode/noisy/0/{model}").meta["windows"]}
        assert list(windows) == ["whole record", "first half", "middle half", "last half"]
        whole = evidence_of(store, f"evidence/noisy/0/{model}/importance")
        assert windows["whole record"] == pytest.approx(whole, abs=0.1)
        halves[model] = [windows["first half"], evidence_of(store, f"sensitivity/noisy/0/{model}/half")]
        assert halves[model][0] == pytest.approx(halves[model][1], abs=0.1)
    assert abs(halves["viscous"][0] - halves["quadratic"][1]) > 0.3


def test_the_evidence_under_each_noise_model_is_that_of_importance_sampling(run):
    """Control: the evidences under the two noise models differ."""
    study, store = run
    for model in ("viscous", "quadratic"):
        candidate = StudyCandidate(study, study.signals[0], 0, model, store)
        noises = store.read(f"sensitivity/noisy/0/{model}/noises").meta
        assert noises["chosen"] == "gaussian"
        logs = {noise: evidence["log_evidence"] for noise, evidence in noises["evidence"].items()}
        start = store.read(f"mode/noisy/0/{model}").meta["values"]
        for noise, log in logs.items():
            target = candidate.case.target(noise)
            mode = find_mode(target, [start], noise_level=candidate.record.features.roughness)
            expected = EVIDENCES.get("importance").evidence(model, target, mode, 7)
            assert log == pytest.approx(expected.log_evidence, abs=0.15)
        assert abs(logs["gaussian"] - logs["student_t"]) > 0.3
