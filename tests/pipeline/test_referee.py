"""Which stored evidence counts if the folder of a run contains results of an earlier run."""

from pathlib import Path

import pytest

from bayesdamp.config import Study
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.evidence import compute_evidence, list_evidence
from bayesdamp.pipeline.records import StudyRecord
from bayesdamp.store.results import EvidenceContent, Store, TaskResult
from bayesdamp.types import Evidence
from tests.studies import COMPARED, VISCOUS, WEIGHED, study_text, write_study


def stored(folder: Path, referee: str) -> tuple[Study, Store]:
    """Return a study whose two methods agree, and a folder that also has the referee's result of an earlier run."""
    settings = WEIGHED.replace("'laplace'", "'importance', 'bridge'").replace("never", referee)
    study = write_study(folder, study_text(COMPARED, settings, simulate=VISCOUS))
    store = Store(folder / "out")
    for method, value in {"importance": -3.0, "bridge": -3.0, "nested": -9.0}.items():
        content = EvidenceContent(Evidence("viscous", method, value, 0.01))
        store.write(TaskResult(f"evidence/rig/0/viscous/{method}", "key", content.meta()))
    return study, store


@pytest.mark.parametrize(("referee", "counts"), [("never", False), ("auto", True)])
def test_the_referee_s_earlier_result_counts_only_if_the_study_has_a_referee(
    tmp_path: Path, referee: str, counts: bool
) -> None:
    study, store = stored(tmp_path, referee)
    evidences = list_evidence(StudyRecord(study, study.signals[0], 0, store), "viscous")
    assert [e.method for e in evidences] == ["importance", "bridge", *["nested"] * counts]


def test_the_referee_is_not_used_because_of_its_own_earlier_result(tmp_path: Path) -> None:
    study, store = stored(tmp_path, "auto")
    candidate = StudyCandidate(study, study.signals[0], 0, "viscous", store)
    assert compute_evidence(candidate, "nested", 0).content == EvidenceContent()
