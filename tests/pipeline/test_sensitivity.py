"""What the evidence is over parts of a record and under other noise, beside the answer."""

from __future__ import annotations

import pytest

from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.search import find_mode
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store
from bayesdamp.types import Seed
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


def test_parts_of_the_record_are_weighed(run):
    """The first half as importance sampling weighs it, to a tenth of a nat. Negative control: the other model's."""
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


def test_each_noise_is_weighed(run):
    """As importance sampling does under each. Negative control: the two noises are not one."""
    study, store = run
    for model in ("viscous", "quadratic"):
        branch = StudyCandidate(study, study.signals[0], 0, model, store)
        cell = store.read(f"sensitivity/noisy/0/{model}/noises")
        assert cell.meta["chosen"] == "gaussian"
        for noise, found in cell.meta["evidence"].items():
            target = branch.case.target(noise)
            start = store.read(f"mode/noisy/0/{model}").meta["values"]
            mode = find_mode(target, {Seed("start"): start}, noise_level=branch.record.features.roughness)
            other = EVIDENCES.get("importance").evidence(model, target, mode, 7)
            assert found["log_evidence"] == pytest.approx(other.log_evidence, abs=0.15)
        by_noise = cell.meta["evidence"]
        assert abs(by_noise["gaussian"]["log_evidence"] - by_noise["student_t"]["log_evidence"]) > 0.3
