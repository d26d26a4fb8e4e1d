"""A second study in a folder: the report and the tables show nothing of the first."""

from __future__ import annotations

import json
from dataclasses import replace

from bayesdamp.pipeline.run import run_study
from bayesdamp.report.results.run import RunFolder
from bayesdamp.store import Store, read_table
from tests.studies import COMPARED, ESTIMATED, WEIGHED, study_text, write_study

STUDY = study_text(
    ESTIMATED, COMPARED, WEIGHED, simulate="viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003"
)


def modes(run: RunFolder) -> set[str]:
    return {cell.name.split("/")[3] for cell in run.task_results("mode")}


def test_the_first_question_does_not_show(tmp_path, monkeypatch):
    monkeypatch.setattr("bayesdamp.report.render.render", lambda *_: None)
    out = tmp_path / "out"
    assert run_study(write_study(tmp_path, STUDY), out, workers=1) == 0
    assert modes(RunFolder(out)) == {"viscous", "quadratic"}
    first = Store(out).names()
    other = write_study(tmp_path, STUDY.replace('"viscous", "quadratic"', '"viscous"'))
    assert run_study(other, out, workers=1) == 0
    assert Store(out).names() == first  # they are there still, and do not show
    assert modes(RunFolder(out)) == {"viscous"}
    assert not any("quadratic" in n for n in json.loads((out / "run.json").read_text())["seconds"])
    assert {r["model"] for r in read_table(out / "fits.csv")} == {"viscous"}
    # what the first had computed is not computed again
    hidden = [n for n in first if "quadratic" in n]
    stamps = {n: (out / "cells" / f"{n}.npz").stat().st_mtime_ns for n in hidden}
    assert run_study(write_study(tmp_path, STUDY), out, workers=1) == 0
    assert {n: (out / "cells" / f"{n}.npz").stat().st_mtime_ns for n in hidden} == stamps
    assert modes(RunFolder(out)) == {"viscous", "quadratic"}
    # Nor does a cell of the same name under another key, as of a fit to another record.
    cell = Store(out).read("mode/rig/0/quadratic")
    Store(out).write(replace(cell, key="another"))
    assert modes(RunFolder(out)) == {"viscous"}
