"""`bayesdamp calibrate`: refusals, simulated records, resuming, and the results for right and wrong posteriors."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.calibrate import ranks, recovery
from bayesdamp.calibrate.run import SOME_FAILED, run_calibration
from bayesdamp.cli import main
from bayesdamp.config import load_study
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.noise.gaussian import Gaussian
from bayesdamp.pipeline.tasks import Product
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.report.sections import render
from bayesdamp.store.results import RecoveryContent
from bayesdamp.types import InputError
from tests.studies import study_text, write_study
from validation.scoring import read_rows

STUDIES = Path(__file__).resolve().parents[2] / "studies"
STUDY = study_text(
    'models = { compare = ["viscous", "coulomb"] }',
    "calibration = { records = 120 }\nrecovery = { records = 240 }",
    "posterior = { warmup = 100, draws = 250 }",
    simulate="viscous = 0.05, duration = 10.0, samples = 300, noise_sd = 0.003",
    name="record",
    system='restoring = "linear", amplitude = 0.3, frequency = 4.5, stiffness = 20.0, rest_angle = 0.0, '
    "theta0 = 0.3, omega0 = 0.0, epsilon = 0.1, "
    'noise_sd = { prior = "lognormal", median = 0.003, sigma = 0.5 }',
)


@pytest.mark.parametrize(
    ("old", "new", "message", "options"),
    [
        ("theta0 = 0.3", 'theta0 = "free"', "prior of theta0 depends on the record", ()),
        ("frequency = 4.5, stiffness = 20.0", 'stiffness = "free"', "system.frequency is missing", ()),
        ("draws = 250", "draws = 20", "it must be at most the 80 draws", ()),
        ("records = 120", "records = 120, binz = 8", "did you mean 'bins'?", ()),
        ('"viscous", "coulomb"', '"viscous"', "names fewer than two models", ("--models",)),
        ("amplitude = 0.3, frequency = 4.5, ", "", "amplitude and frequency", ("--models",)),
    ],
)
def test_a_study_that_cannot_be_calibrated_is_refused(tmp_path, capsys, old, new, message, options):
    """And nothing is written."""
    assert old in STUDY
    text = STUDY.replace(old, new, 1).replace("simulate = {", "simulate = { theta0 = 0.3, stiffness = 20.0,")
    file, out = tmp_path / "small.toml", tmp_path / "out"
    file.write_text(text, encoding="utf-8")
    assert main(["calibrate", str(file), "--out", str(out), *options]) == 2
    line = capsys.readouterr().err
    assert message in line
    assert line.count("\n") == 1
    assert not out.exists()


def test_the_included_studies_can_be_run():
    ranks.check(load_study(STUDIES / "calibration.toml"))
    study = load_study(STUDIES / "model_recovery.toml")
    recovery.check(study)
    levels = {recovery.design_of(study, i) for i in range(16)}
    assert len(levels) == 8
    assert study.recovery.records >= 10 * len(levels)
    assert len(study.models.compare) == 7


def test_simulated_records_have_the_prior_and_the_noise_that_the_posterior_uses(tmp_path):
    """The noise within four standard errors. The name of a record is its seed."""
    generator = ranks.make_generator(load_study(STUDIES / "calibration.toml"), "viscous")
    assert generator.blank.names == ("zeta", "stiffness", "theta0", "omega0", "noise_sd")
    drawn = generator.draw(ranks.record_rng(1, "a"), "a")
    assert drawn.target.priors is generator.blank.priors
    assert set(drawn.truth) == set(generator.blank.names)
    np.testing.assert_array_equal(generator.draw(ranks.record_rng(1, "a"), "a").signal.y, drawn.signal.y)
    assert generator.draw(ranks.record_rng(1, "b"), "b").truth["zeta"] != drawn.truth["zeta"]
    p, rng = {**generator.blank.known, **drawn.truth}, np.random.default_rng(0)
    clean = simulate_signal(generator.blank.oscillator, p, duration=10.0, samples=401, rng=rng)
    assert abs(np.std(drawn.signal.y - clean.y) / drawn.truth["noise_sd"] - 1) < 4 / np.sqrt(2 * 401)


@pytest.mark.parametrize(
    ("law", "simulated"),
    [
        ('"pendulum", amplitude = 0.3, stiffness = 9.81, rest_angle = 0.37', ""),
        (
            '"duffing", amplitude = 0.3, frequency = 20.0, stiffness = "free", rest_angle = 0.0, cubic = -50.0',
            "stiffness = 400.0, ",
        ),
    ],
)
def test_the_reference_amplitude_and_frequency_are_those_of_the_study(tmp_path, law, simulated):
    """An equilibrium by iterations has rounding errors; a stated frequency needs no law. Control: without an amplitude
    the study is refused."""
    old = '"linear", amplitude = 0.3, frequency = 4.5, stiffness = 20.0, rest_angle = 0.0'
    assert old in STUDY
    text = STUDY.replace(old, law).replace("simulate = {", f"simulate = {{ {simulated}")
    assert ranks.make_generator(write_study(tmp_path, text), "viscous").blank.names[0] == "zeta"
    bare = text.replace("amplitude = 0.3, ", "").replace("theta0 = 0.3, omega0", 'theta0 = "free", omega0')
    bare = bare.replace("simulate = {", "simulate = { theta0 = 0.3, ")
    with pytest.raises(InputError, match="amplitude is missing"):
        ranks.make_generator(write_study(tmp_path, bare), "viscous")


KNOWN = STUDY.replace("records = 120", 'records = 12, samplers = ["nuts"]').replace(', "coulomb"', "")


class Misjudged(Gaussian):
    """A wrong likelihood, whose noise is 0.8 of its parameter."""

    def log_likelihood(self, r, gaps, p):
        return super().log_likelihood(r, gaps, smaller(p))

    def parameter_slopes(self, r, gaps, p):
        return {n: 0.8 * v for n, v in super().parameter_slopes(r, gaps, smaller(p)).items()}

    def slope(self, r, gaps, p):
        return super().slope(r, gaps, smaller(p))

    def information_root(self, v, gaps, p):
        return super().information_root(v, gaps, smaller(p))


def smaller(p):
    return {**p, "noise_sd": 0.8 * p["noise_sd"]}


@pytest.fixture
def misjudged():
    NOISES.add("misjudged", Misjudged())
    yield 'noise = "misjudged"'
    NOISES.remove("misjudged")


@pytest.mark.parametrize("right", [True, False])
def test_only_a_wrong_likelihood_fails(tmp_path, monkeypatch, misjudged, right):
    """The false-alarm rate of the right one is 1 %. A chunk that is lost is computed again, to the same table."""
    monkeypatch.setattr(ranks, "RECORDS_PER_TASK", 12)
    text = KNOWN if right else KNOWN.replace("posterior = {", f"posterior = {{ {misjudged},")
    study, out = write_study(tmp_path, text), tmp_path / "out"
    assert run_calibration(study, out, workers=1) == 0
    result = json.loads((out / "run.json").read_text())["result"]
    posterior = result["families"]["posterior"]
    assert (posterior["wrong"] == 0) is right
    assert result["families"]["classical"]["wrong"] == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert f"{posterior['wrong'] or 'None'} of {posterior['tests']} checks of the posteriors failed" in page
    assert '<th class="t">records left out, and why</th>' in page  # text is aligned to the left
    counts = result["counts"]["viscous"]
    assert sum(counts["refused"].values()) == counts["tried"] - counts["counted"]
    for text in read_rows(out / "ranks.csv")["ranks"]:
        ranked = [int(rank) for rank in text.split()]
        assert len(ranked) == counts["counted"] <= counts["tried"] == 12
        assert 0 <= min(ranked) <= max(ranked) <= 255
    if not right:
        return
    counts |= {"refused": {"few": 3, "many": 5}, "counted": 4, "seconds": {"nuts": 36}}
    info = json.loads((out / "run.json").read_text())
    (out / "run.json").write_text(json.dumps(info | {"result": result}))
    page = render(out).read_text(encoding="utf-8")
    assert all(text in page for text in ("<td>12</td><td>4</td>", "<td>3.0 s</td>", ">5: many; 3: few<"))
    coverage = read_rows(out / "calibration.csv").dropna(subset="level")["value"]
    assert all(f"<td>{100 * share:.1f}" in page for share in coverage)
    before, calls, compute = (out / "ranks.csv").read_bytes(), [], ranks.compute_chunk
    monkeypatch.setattr(ranks, "compute_chunk", lambda *given: calls.append(given[2]) or compute(*given))
    lost = sorted((out / "cells").rglob("viscous/*.npz"))[-1]
    lost.unlink()
    assert run_calibration(study, out, workers=1, report=False) == 0
    assert calls == [int(lost.stem)]
    assert (out / "ranks.csv").read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("right", [True, False])
def test_both_samplers_are_calibrated_and_detect_a_wrong_likelihood(tmp_path, misjudged, right):
    """With free start and stiffness, and friction and viscous damping near zero. False-alarm rate 1 %."""
    text = (STUDIES / "calibration.toml").read_text().replace("records = 500", "records = 96")
    text = text.replace('"viscous", "coulomb", "quadratic", ', "")
    text = text if right else text.replace("[posterior]", f"[posterior]\n{misjudged}")
    assert run_calibration(write_study(tmp_path, text), tmp_path / "out", workers=1, report=False) == 0
    wrong = read_rows(tmp_path / "out" / "calibration.csv").query("verdict == 'wrong'")
    assert wrong.empty is right
    if not right:
        assert {"nuts", "emcee"} <= set(wrong.query("parameter == 'noise_sd'")["method"])


def simulated_chunks(sharper: float):
    """Return a function that draws chunks of probabilities whose log odds are `sharper` times the right ones."""

    def chunk(study, series, first):
        rng = np.random.default_rng([first, len(series)])
        models, size = study.models.compare, recovery.RECORDS_PER_TASK
        odds = 1.5 * rng.standard_normal((size, len(models)))
        right = np.exp(odds - logsumexp(odds, axis=1, keepdims=True))
        truth = [rng.choice(len(models), p=p) for p in right]
        stated = np.exp(sharper * odds - logsumexp(sharper * odds, axis=1, keepdims=True))
        meta = {
            "first": first, "models": models, "accepted": [True] * size,
            "outcomes": ["failed: x" if first + i == 21 else "ok" for i in range(size)],
            "evidence_outcomes": [["ok"] * len(models)] * size,
        }  # fmt: skip
        design = np.array([recovery.design_of(study, first + i) for i in range(size)])
        arrays = {"model": np.array(truth), "probability": stated, "log_evidence": odds, "design": design}
        return Product(RecoveryContent.of_meta(meta), arrays)

    return chunk


@pytest.mark.parametrize(("sharper", "inside"), [(1.0, True), (2.0, False)])
def test_overconfident_probabilities_are_detected(tmp_path, monkeypatch, capsys, sharper, inside):
    """False-alarm rate 1 %. Right probabilities have the log score that they predict. The line on a failed record has
    its number in the table."""
    study, out = write_study(tmp_path, STUDY), tmp_path / "out"
    monkeypatch.setattr(recovery, "compute_chunk", simulated_chunks(sharper))
    assert run_calibration(study, out, models=True, workers=1) == SOME_FAILED
    assert capsys.readouterr().err.endswith("recovery, record 21: failed: x\n")
    result = json.loads((out / "run.json").read_text())["result"]["recovery"]
    hits = result["hits"]
    assert (hits["low"] <= hits["excess"] <= hits["high"]) is inside
    assert sum(map(sum, result["confusion"])) == hits["records"] == 240
    assert (result["log_score_expected"] - result["log_score"] < 0.15) is inside
    assert read_rows(out / "recovery.csv").query("outcome != 'ok'")["record"].tolist() == [21]
    page = (out / "report.html").read_text(encoding="utf-8")
    assert ("is inside the 99 % band" in page) is inside
    share = f"95 % interval {100 * hits['share_low']:.1f} to {100 * hits['share_high']:.1f} %"
    assert f"{share}); {hits['expected']:.1f} are expected" in page
    assert f"{result['doubtful']} of {result['evidences']} evidence values" in page
    for b in result["bins"]:
        assert f">{b['from']:g} to {b['to']:g}</td><td>{b['records']}</td>" in page
        assert "".join(f"<td>{b[n]:.3f}</td>" for n in ("probability", "share", "low", "high")) in page
