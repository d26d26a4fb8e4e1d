"""The steps of a run, with every computation left out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from bayesdamp.config import load_study
from bayesdamp.config.load import shipped_folder
from bayesdamp.pipeline import Depth, run


@pytest.mark.parametrize(("depth", "times"), [(Depth.ANSWER, 1), (Depth.SAMPLED, 2)])
def test_verdicts_are_written_once_after_each_stage_that_changes_them(
    depth: Depth, times: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[Any] = []
    monkeypatch.setattr(run, "write_verdicts", lambda *arguments: written.append(arguments))
    for name in ("_run_jobs", "write_tables", "_render"):
        monkeypatch.setattr(run, name, lambda *_: None)
    study = load_study(shipped_folder() / "quickstart.toml")
    assert run.run_study(study, tmp_path, workers=1, depth=depth, quiet=True) == 0
    assert len(written) == times
