"""The overview of many records, and the estimates against the posterior of their record."""

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bayesdamp.report import sections
from bayesdamp.report.results.estimators import estimates_of
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.terminal import print_conclusion
from bayesdamp.store.files import write_json
from bayesdamp.store.results import ComparedCandidate, Store, TaskResult, claim
from bayesdamp.verdict.parts import DampingRatio, Grade, Interval
from bayesdamp.verdict.types import Verdict

SIZES = {"rig_run_1": 0.01, "rig_run_2": 0.03, "rig_run_3": 0.02}


def verdict(record: str, size: float) -> Verdict:
    ratio = DampingRatio(0.2, "rad", size, 1e-4, 1e-4, 0.9 * size, 1.1 * size)
    return Verdict(
        record, Grade.EXACT, True, "viscous", 0.98, frequency=Interval(1.2, 1.19, 1.21, "Hz"), damping_ratio=(ratio,),
        sentence=f"{record} is viscous.", deviation=Interval(0.001, 0.0, 0.0058),
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, sketchy: None) -> Path:
    claim(tmp_path)
    store, a = Store(tmp_path), np.geomspace(0.05, 0.3, 20)
    t = np.linspace(0, 5, 50)
    for name, size in SIZES.items():
        arrays = {"amplitude": a, "ratio": np.full(20, size), "low": np.full(20, 0.9 * size), "t": t}
        arrays |= {"work/viscous": a**2, "high": np.full(20, 1.1 * size)}
        arrays |= {"record": np.cos(t), "fit": np.cos(t), "residual": 0 * t}
        candidates = [asdict(ComparedCandidate("viscous", "linear", 0.0, 0.0, 0.01))]
        meta = {"verdict": verdict(name, size).to_dict(), "candidates": candidates}
        store.write(TaskResult(f"answer/{name}/0", "key", meta, arrays))
    about = {name: {"unit": "deg", "quantity": "angle", "simulated": False} for name in SIZES}
    write_json(tmp_path / "run.json", {"name": "rig", "signals": about, "models": ["viscous"]})
    together = [verdict(n, s).to_dict() for n, s in SIZES.items()] + [verdict("rig", 0.02).to_dict()]
    write_json(tmp_path / "verdict.json", together)
    return tmp_path


def test_the_overview_has_the_common_answer_first_and_a_link_to_each_record(folder: Path) -> None:
    page = sections.render(folder).read_text(encoding="utf-8")
    section = page[page.index('id="overview"') : page.index('id="answer"')]
    assert "Viscous damping (probability 0.98)" in section
    assert section.index("Viscous damping (probability 0.98)") < section.index("<figure")
    for name in SIZES:
        assert section.count(f'href="#answer-{name}"') == 1
        assert f'id="answer-{name}"' in page


def test_the_caption_says_how_the_damping_ratio_was_measured(folder: Path) -> None:
    """For one of the three records it is measured without a law, so that there is no ratio by the laws."""
    store = Store(folder)
    result = store.read("answer/rig_run_1/0")
    arrays = {n: values for n, values in result.arrays.items() if n not in ("ratio", "low", "high")}
    measured = "amplitude", "ratio", "ratio_low", "ratio_high", "lost"
    arrays |= {f"free/{n}": arrays["amplitude"] for n in measured}
    store.write(replace(result, arrays=arrays))
    page = sections.render(folder).read_text(encoding="utf-8")
    once, twice = "both measured without assuming a damping law", "both averaged over the compared models"
    # In the caption and in the text in place of the picture.
    assert (page.count(once), page.count(twice)) == (2, 4)


def test_only_the_first_of_many_records_have_figures(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their tables are complete, also if a thread makes them. Control: with a larger limit, all have a figure."""
    for most, pool in product((2, 3), (None, ThreadPoolExecutor(1))):
        monkeypatch.setattr(sections, "MOST_DRAWN", most)
        page = sections.render(folder, pool).read_text(encoding="utf-8")
        names = {path.stem for path in (folder / "figures").glob("answer-*.svg")}
        assert names == {f"answer-{name}" for name in list(SIZES)[:most]}
        assert ("of 3 signals have figures" in page) == (most == 2)
        assert page.count("All damping models that were compared") == 3


def test_the_terminal_has_the_common_answer_first_and_a_line_for_each_record(folder: Path) -> None:
    out = io.StringIO()
    print_conclusion(folder, Console(file=out, width=120))
    text = out.getvalue()
    lines = [line.split() for line in text.splitlines()]
    assert [line[0] for line in lines if "viscous" in line] == list(SIZES)
    assert text.index("rig: Viscous damping") < text.index("record ")
    assert "3.00 % (2.70 to 3.30), 11 deg" in text


def test_estimates_are_compared_with_the_posterior_of_their_own_record(whole_run: Path) -> None:
    run = RunFolder(whole_run)
    estimates = estimates_of(run, "sim", "viscous")[0]
    assert estimates.truth == 0.05
    assert len(estimates.own) == len(estimates.refined) == 11
    place = {"signal": "sim", "repeat": 0, "model": "viscous", "sampler": "nuts", "parameter": "zeta"}
    (row,) = (row for row in run.posteriors if place.items() <= row.items())
    assert estimates.posterior == (row["q2.5"], row["q97.5"])
    assert np.isnan(estimates_of(run, "bench", "viscous")[0].truth)
