"""`bayesdamp calibrate`: what it refuses and draws, how it resumes, what its tables say of a wrong posterior."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.calibrate import problem, ranks, recovery, run_calibration
from bayesdamp.calibrate.run import RecordSeries, next_wave
from bayesdamp.cli import main
from bayesdamp.config import load_study
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.noise.gaussian import Gaussian
from bayesdamp.pipeline.tasks import Product
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.report import render
from bayesdamp.store import CellResult
from bayesdamp.store.contents import RanksContent, RecoveryContent
from bayesdamp.types import InputError

STUDIES = Path(__file__).resolve().parents[2] / "studies"
STUDY = """
version = 1
name = "small"
seed = 3
[system]
restoring = "linear"
amplitude = 0.3
frequency = 4.5
stiffness = 20.0
rest_angle = 0.0
theta0 = 0.3
omega0 = 0.0
epsilon = 0.1
noise_sd = { prior = "lognormal", median = 0.003, sigma = 0.5 }
[[signal]]
name = "record"
simulate = { viscous = 0.05, duration = 10.0, samples = 300, noise_sd = 0.003 }
[models]
compare = ["viscous", "coulomb"]
[posterior]
warmup = 100
draws = 250
[calibration]
records = 120
[recovery]
records = 240
single = 200
"""


def write(folder: Path, text: str = STUDY) -> Path:
    file = folder / "small.toml"
    file.write_text(text, encoding="utf-8")
    return file


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as handle:
        return list(csv.DictReader(handle))


# What is refused, before anything is written.


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            '{ prior = "lognormal", median = 0.003, sigma = 0.5 }',
            '"free"',
            "prior of noise_sd depends on the record",
        ),
        ("theta0 = 0.3\n", 'theta0 = "free"\n', "prior of theta0 depends on the record"),
        ("frequency = 4.5\nstiffness = 20.0", 'stiffness = "free"', "system.frequency is missing"),
        ("draws = 250", "draws = 20", "it must be at most the 80 draws"),
        ("records = 120", "records = 120\nbinz = 8", "did you mean 'bins'?"),
        ("records = 120", "records = 120\nbins = 10", "must divide draws"),
        ("records = 120", 'records = 120\nsamplers = ["nutz"]', "did you mean 'nuts'?"),
        ("records = 240", "records = 240\ncycle = [3]", "did you mean 'cycles'?"),
    ],
)
def test_what_cannot_be_calibrated_is_refused_in_one_line(tmp_path, capsys, old, new, said):
    assert old in STUDY
    text = STUDY.replace(old, new, 1).replace("simulate = {", "simulate = { theta0 = 0.3, stiffness = 20.0,")
    out = tmp_path / "out"
    assert main(["calibrate", str(write(tmp_path, text)), "--out", str(out)]) == 2
    line = capsys.readouterr().err
    assert said in line
    assert line.count("\n") == 1
    assert not out.exists()


def test_models_need_a_reference_and_company(tmp_path):
    alone = load_study(write(tmp_path, STUDY.replace('"viscous", "coulomb"', '"viscous"')))
    with pytest.raises(InputError, match="has 1 models to tell apart"):
        run_calibration(alone, tmp_path / "out", models=True)
    bare = load_study(write(tmp_path, STUDY.replace("amplitude = 0.3\nfrequency = 4.5\n", "")))
    with pytest.raises(InputError, match="amplitude and frequency"):
        run_calibration(bare, tmp_path / "out", models=True)
    assert not (tmp_path / "out").exists()


def test_the_study_that_ships_can_be_calibrated():
    study = load_study(STUDIES / "calibration.toml")
    ranks.check(study)
    assert study.calibration.records >= 50
    assert study.models.compare == ("viscous", "coulomb", "quadratic", "viscous+coulomb")


def test_the_model_recovery_that_ships_covers_its_design():
    study = load_study(STUDIES / "model_recovery.toml")
    recovery.check(study)
    levels = {recovery.level(study, "recovery", i) for i in range(16)}
    assert len(levels) == 8
    assert study.recovery.records >= 10 * len(levels)
    assert len(recovery.models_of(study, "recovery")) == 7
    assert recovery.models_of(study, "single") == ["viscous", "coulomb", "quadratic"]


# What is drawn.


def test_what_is_drawn_has_the_prior_that_the_posterior_uses(tmp_path):
    made = problem.generator(load_study(STUDIES / "calibration.toml"), "viscous")
    assert made.blank.names == ("zeta", "stiffness", "theta0", "omega0", "noise_sd")
    drawn = made.draw(problem.record_rng(1, "a"), "a")
    assert drawn.target.priors is made.blank.priors
    assert set(drawn.truth) == set(made.blank.names)
    again = made.draw(problem.record_rng(1, "a"), "a")
    assert dict(again.truth) == dict(drawn.truth)
    np.testing.assert_array_equal(again.signal.y, drawn.signal.y)
    other = made.draw(problem.record_rng(1, "b"), "b")
    assert other.truth["zeta"] != drawn.truth["zeta"]
    # The noise of the record is that which was drawn: four standard errors.
    quiet = problem.replace(made, blank=problem.replace(made.blank)).draw(problem.record_rng(1, "a"), "a")
    clean = simulate_signal(
        made.blank.oscillator,
        {**made.blank.known, **quiet.truth},
        duration=10.0,
        samples=401,
        rng=np.random.default_rng(0),
    )
    ratio = np.std(drawn.signal.y - clean.y) / drawn.truth["noise_sd"]
    assert abs(ratio - 1) < 4 / np.sqrt(2 * 401)


# How it resumes.


def test_waves_follow_from_what_was_accepted():
    series = RecordSeries("ranks", 100, "viscous")

    def chunks(n: int, good: int) -> list[CellResult]:
        return [CellResult(f"ranks/viscous/{i}", "", {"accepted": [True] * good}) for i in range(n)]

    assert next_wave(series, []) == [16 * i for i in range(7)]
    assert next_wave(series, chunks(7, 15)) == []
    assert next_wave(series, chunks(7, 8)) == [112 + 16 * i for i in range(6)]  # 44 more at a half
    assert next_wave(series, chunks(125, 0)) == []  # never: it ends short
    assert next_wave(series, [CellResult("a", "", outcome="failed: x")]) == []


def synthetic(scale: float, calls: list[int], refuse: bool = False):
    """Chunks of a toy posterior whose sds are `scale` times what they should be."""

    def ranked(study, model, first):
        calls.append(first)
        rng = np.random.default_rng([first, len(model)])
        names, size = ["zeta", "noise_sd", ranks.LIKELIHOOD], ranks.CHUNK
        z = rng.standard_normal((size, 2, 3)) / scale
        draws = rng.standard_normal((size, 2, 3, 255))
        place = np.sum(draws < z[..., None], axis=-1)
        ok = [not (refuse and i % 4 == 0) for i in range(size)]
        place[~np.array(ok)] = -1
        meta = {
            "first": first,
            "model": model,
            "names": names,
            "outcomes": ["ok" if good else "no oscillation" for good in ok],
            "accepted": ok,
            "sampler_outcomes": {s: ["ok" if good else "" for good in ok] for s in ("nuts", "emcee")},
            "seconds": {"record": 1.0, "nuts": 1.0, "emcee": 1.0},
        }
        value = rng.standard_normal((size, 3))
        arrays = {
            "truth": np.zeros((size, 3)),
            "value": value,
            "stderr": np.ones((size, 3)),
            "ranks": place,
            "below": place / 255,
        }
        return Product(RanksContent.of_meta(meta), arrays)

    return ranked


def test_a_run_resumes_and_a_right_posterior_passes(tmp_path, monkeypatch):
    study, out, calls = load_study(write(tmp_path)), tmp_path / "out", []
    monkeypatch.setattr(ranks, "compute_chunk", synthetic(1.0, calls, refuse=True))
    assert run_calibration(study, out, workers=1, records=40) == 0
    first = len(calls)
    assert run_calibration(study, out, workers=1) == 0
    assert len(calls) > first
    assert max(calls.count(one) for one in calls) == 2  # once for each model
    everything = len(calls)
    lost = out / "cells" / "ranks" / "coulomb" / "000016.npz"
    before = (out / "ranks.csv").read_bytes()
    lost.unlink()
    assert run_calibration(study, out, workers=1) == 0
    assert calls[everything:] == [16]
    assert (out / "ranks.csv").read_bytes() == before
    info = json.loads((out / "run.json").read_text())
    for model in ("viscous", "coulomb"):
        counts = info["result"]["counts"][model]
        assert counts["counted"] >= 120
        assert counts["refused"] == {"no oscillation": counts["tried"] - counts["counted"]}
    # false-alarm rate 1 % for each of the two tables
    assert info["result"]["families"]["posterior"]["wrong"] == 0
    assert info["result"]["families"]["classical"]["wrong"] == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Are the intervals calibrated?" in page
    assert "no oscillation" in page
    tests = info["result"]["families"]["posterior"]["tests"]
    assert f"None of {tests} checks of the posteriors failed" in page


def test_a_wrong_posterior_is_called_wrong(tmp_path, monkeypatch):
    """Negative control: sds of 0.8 times what they should be; the refined estimates' intervals are right."""
    study, out = load_study(write(tmp_path)), tmp_path / "out"
    monkeypatch.setattr(ranks, "compute_chunk", synthetic(0.8, []))
    assert run_calibration(study, out, workers=1, records=500, report=False) == 0
    assert not (out / "report.html").exists()
    families = json.loads((out / "run.json").read_text())["result"]["families"]
    assert families["posterior"]["wrong"] > 0
    assert families["classical"]["wrong"] == 0
    wrong = [r for r in rows(out / "calibration.csv") if r["verdict"] == "wrong"]
    assert {r["method"] for r in wrong} == {"nuts", "emcee"}
    claim = f"{families['posterior']['wrong']} of {families['posterior']['tests']} checks of the posteriors failed"
    assert claim in render(out).read_text(encoding="utf-8")


def test_a_chunk_that_fails_is_named_and_tried_again(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("BAYESDAMP_DEBUG", raising=False)
    study, out, calls = load_study(write(tmp_path)), tmp_path / "out", []
    good = synthetic(1.0, calls)

    def broken(study, model, first):
        if first == 16 and model == "viscous":
            raise ArithmeticError("made to fail")
        return good(study, model, first)

    monkeypatch.setattr(ranks, "compute_chunk", broken)
    assert run_calibration(study, out, workers=1, records=40, report=False) == 3
    assert "ranks/viscous/000016: failed: ArithmeticError: made to fail" in capsys.readouterr().err
    done = len(calls)
    monkeypatch.setattr(ranks, "compute_chunk", good)
    assert run_calibration(study, out, workers=1, records=40, report=False) == 0
    assert calls[done:] == [16]


# The whole way, with draws from the Laplace fit, which compile soon; the samplers' own calibration is below.

KNOWN = STUDY.replace("records = 120", 'records = 12\nsamplers = ["laplace"]').replace(', "coulomb"', "")


class Misjudged(Gaussian):
    """A likelihood made wrong on purpose: the noise is taken to be 0.8 of what the parameter says."""

    def log_likelihood(self, r, gaps, p):
        return super().log_likelihood(r, gaps, {**p, "noise_sd": 0.8 * p["noise_sd"]})

    def parameter_slopes(self, r, gaps, p):
        return {
            n: 0.8 * v
            for n, v in super().parameter_slopes(r, gaps, {**p, "noise_sd": 0.8 * p["noise_sd"]}).items()
        }

    def slope(self, r, gaps, p):
        return super().slope(r, gaps, {**p, "noise_sd": 0.8 * p["noise_sd"]})

    def information_root(self, v, gaps, p):
        return super().information_root(v, gaps, {**p, "noise_sd": 0.8 * p["noise_sd"]})


@pytest.fixture
def misjudged():
    NOISES.add("misjudged", Misjudged())
    yield 'noise = "misjudged"'
    NOISES.remove("misjudged")


@pytest.mark.parametrize("right", [True, False])
def test_a_wrong_likelihood_fails_and_a_right_one_does_not(tmp_path, monkeypatch, misjudged, right):
    monkeypatch.setattr(ranks, "CHUNK", 12)
    text = KNOWN if right else KNOWN.replace("[posterior]", f"[posterior]\n{misjudged}")
    assert run_calibration(load_study(write(tmp_path, text)), tmp_path / "out", workers=1, report=False) == 0
    families = json.loads((tmp_path / "out" / "run.json").read_text())["result"]["families"]
    # false-alarm rate 1 % for the right one
    assert (families["posterior"]["wrong"] == 0) is right
    assert families["classical"]["wrong"] == 0
    for row in rows(tmp_path / "out" / "ranks.csv"):
        ranked = [int(text) for text in row["ranks"].split()]
        assert 12 <= len(ranked) < 24  # a second wave where some records were refused
        assert min(ranked) >= 0
        assert max(ranked) <= 255


@pytest.mark.slow
@pytest.mark.parametrize("right", [True, False])
def test_both_samplers_are_calibrated_and_see_a_wrong_likelihood(tmp_path, misjudged, right):
    """Free start and stiffness, friction and viscous damping that touch zero; false-alarm rate 1 %."""
    text = (STUDIES / "calibration.toml").read_text().replace("records = 500", "records = 96")
    text = text.replace('"viscous", "coulomb", "quadratic", ', "")
    text = text if right else text.replace("[posterior]", f"[posterior]\n{misjudged}")
    assert run_calibration(load_study(write(tmp_path, text)), tmp_path / "out", workers=1, report=False) == 0
    wrong = [r for r in rows(tmp_path / "out" / "calibration.csv") if r["verdict"] == "wrong"]
    assert (not wrong) is right
    if not right:
        assert {"nuts", "emcee"} <= {r["method"] for r in wrong if r["parameter"] == "noise_sd"}


# The models' probabilities.


def invented(sharper: float):
    """Chunks of probabilities whose log odds are `sharper` times what they should be."""

    def recovered(study, kind, first):
        rng = np.random.default_rng([first, len(kind)])
        models, size = recovery.models_of(study, kind), recovery.CHUNK
        odds = 1.5 * rng.standard_normal((size, len(models)))
        right = np.exp(odds - logsumexp(odds, axis=1, keepdims=True))
        truth = [rng.choice(len(models), p=p) for p in right]
        told = np.exp(sharper * odds - logsumexp(sharper * odds, axis=1, keepdims=True))
        meta = {
            "first": first,
            "models": models,
            "outcomes": ["ok"] * size,
            "accepted": [True] * size,
            "evidence_outcomes": [["ok"] * len(models)] * size,
        }
        design = np.array([recovery.level(study, kind, first + i) for i in range(size)])
        arrays = {
            "model": np.array(truth),
            "probability": told,
            "log_evidence": odds,
            "design": design,
            "loss": np.ones(size),
        }
        return Product(RecoveryContent.of_meta(meta), arrays)

    return recovered


@pytest.mark.parametrize(("sharper", "inside"), [(1.0, True), (2.0, False)])
def test_overconfident_probabilities_are_seen(tmp_path, monkeypatch, sharper, inside):
    study, out = load_study(write(tmp_path)), tmp_path / "out"
    monkeypatch.setattr(recovery, "compute_chunk", invented(sharper))
    assert run_calibration(study, out, models=True, workers=1) == 0
    result = json.loads((out / "run.json").read_text())["result"]
    for series in ("recovery", "single"):
        hits = result[series]["hits"]
        # false-alarm rate 1 % each
        assert (hits["low"] <= hits["excess"] <= hits["high"]) is inside
        assert (
            sum(map(sum, result[series]["confusion"]))
            == hits["records"]
            == (240 if series == "recovery" else 200)
        )
        # Probabilities that are right promise the log score that they get.
        gap = result[series]["log_score_expected"] - result[series]["log_score"]
        assert (gap < 0.15) is inside
    assert len(rows(out / "recovery.csv")) == 440
    page = (out / "report.html").read_text(encoding="utf-8")
    assert ("is inside its 99 % band" in page) is inside
    assert result["recovery"]["by_model"][0]["p_holm"] > 0.001 or not inside
