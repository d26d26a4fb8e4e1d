"""A second study in the same folder: its tables and report contain nothing of the first study."""

import json
from dataclasses import replace
from pathlib import Path

from bayesdamp.report.results.run import RunFolder
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.studies import COMPARED, ESTIMATED, WEIGHED, finish_study, study_text

STUDY = study_text(
    ESTIMATED, COMPARED, WEIGHED, simulate="viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003"
)


def modes(out: Path) -> set[str]:
    return {result.name.split("/")[3] for result in RunFolder(out).task_results("mode")}


def test_results_of_an_earlier_study_are_kept_but_not_shown(tmp_path, monkeypatch):
    monkeypatch.setattr("bayesdamp.report.sections.render", lambda *_: None)
    out = finish_study(tmp_path, STUDY)
    assert modes(out) == {"viscous", "quadratic"}
    first = Store(out).names()
    finish_study(tmp_path, STUDY.replace('"viscous", "quadratic"', '"viscous"'))
    assert Store(out).names() == first
    assert modes(out) == {"viscous"}
    assert not any("quadratic" in n for n in json.loads((out / "run.json").read_text())["seconds"])
    assert {r["model"] for r in read_table(out / "fits.csv")} == {"viscous"}
    # The first study again: its results are not computed a second time.
    files = [out / "cells" / f"{n}.npz" for n in first if "quadratic" in n]
    stamps = [file.stat().st_mtime_ns for file in files]
    finish_study(tmp_path, STUDY)
    assert [file.stat().st_mtime_ns for file in files] == stamps
    assert modes(out) == {"viscous", "quadratic"}
    # A result of the same name with another key, such as a fit to another record, is not shown.
    Store(out).write(replace(Store(out).read("mode/rig/0/quadratic"), key="another"))
    assert modes(out) == {"viscous"}
    # Nor are verdicts, if the study has no methods for them any more.
    assert (out / "verdict.json").is_file()
    finish_study(tmp_path, STUDY.replace(WEIGHED, "posterior.samplers = []\nevidence.methods = []"))
    assert not list(out.glob("verdict*")) + list(out.glob("damping_curves*"))
