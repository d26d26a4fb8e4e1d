"""The examples of docs/extending.md work as they stand there: one study has all of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.inference.noise import NOISES
from bayesdamp.pipeline.run import run_study
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report.sections import SECTIONS
from bayesdamp.store import read_table
from tests.studies import SYSTEM, study_text, write_study

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
BLOCKS: list[str] = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
STUDY = study_text(
    "plugins = { modules = [FILES] }",
    'estimators = { use = ["half_life"], stages = ["initial"] }',
    'models = { compare = ["viscous", "cubic_drag", "thinning", "rubbing"] }',
    'posterior = { samplers = ["at_the_mode"], noise = "logistic" }',
    'evidence = { methods = ["unit_information"], referee = "never" }',
    simulate="viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003",
    system=SYSTEM.replace("linear", "soft_spring"),
)


def use(folder: Path, block: str) -> None:
    """Use a plug-in of this source."""
    (folder / "own.py").write_text(block, encoding="utf-8")
    use_modules(read_modules([folder / "own.py"]))


@pytest.mark.slow
def test_a_term_with_a_parameter_of_its_own(tmp_path):
    """Simulated and weighed from one file: found outright, its parameter within the 95 % interval (the record's seed
    was not chosen; a false alarm once in 20)."""
    use(tmp_path, BLOCKS[0])
    signal = bd.simulate(
        {"thinning": 0.3}, "linear", stiffness=20.0, theta0=0.3, thinning_velocity=0.4, duration=25.0, samples=900,
        noise_sd=0.003,
    )  # fmt: skip
    verdict = bd.compare(signal, damping=["viscous", "coulomb", "thinning"], restoring=["linear"]).verdict
    assert verdict.decided
    assert verdict.damping == "thinning"
    own = {c.name: c for c in verdict.coefficients}
    assert own["thinning_velocity"].low < 0.4 < own["thinning_velocity"].high
    assert own["thinning_velocity"].unit == "rad/s"
    assert own["c_thinning"].low < 0.3 < own["c_thinning"].high


def test_a_reader_of_ones_own(tmp_path, capsys):
    """By its content, whatever the file's name; by look, compare and a study's own modules; without it the file is of
    no format."""
    (block,) = [b for b in BLOCKS if "Reader" in b]
    (tmp_path / "own.py").write_text(block, encoding="utf-8")
    t = np.arange(400) / 50.0
    angles = 300.0 * np.exp(-0.1 * t) * np.cos(4.47 * t) + np.random.default_rng(0).normal(0.0, 1.0, t.size)
    file = tmp_path / "swing.dat"
    file.write_bytes(b"RIG1" + np.array([50.0, *angles], "<f4").tobytes())
    with pytest.raises(bd.InputError, match="unknown format"):
        bd.read(file)
    assert main(["look", str(file), "--plugin", str(tmp_path / "own.py")]) == 0
    assert "phi" in capsys.readouterr().out
    use_modules(read_modules([tmp_path / "own.py"]))
    signal = bd.read(file).signal()
    assert signal.provenance.unit == "mrad"
    assert np.ptp(signal.y) == pytest.approx(0.58, abs=0.05)
    file.write_bytes(b"RIG1")
    with pytest.raises(bd.InputError, match="not readable as a file of our rig"):
        bd.read(file)


def test_a_noise_of_ones_own(tmp_path):
    """Its density is SciPy's, it is drawn from, and the defaults give its slope and a start near the truth."""
    (block,) = [b for b in BLOCKS if "IndependentNoise" in b]
    use(tmp_path, block)
    noise, p, gaps = NOISES.get("logistic"), {"noise_sd": 0.02}, np.full(3999, 0.01)
    r = noise.draw(np.random.default_rng(0), gaps, p)
    law = stats.logistic(scale=np.sqrt(3) / np.pi * 0.02)
    assert law.std() == pytest.approx(0.02)
    assert noise.log_likelihood(r, gaps, p) == pytest.approx(law.logpdf(r).sum())
    assert noise.log_likelihood(r, gaps, p) > stats.norm.logpdf(r, scale=0.02).sum() + 20
    scale = law.kwds["scale"]
    np.testing.assert_allclose(noise.slope(r, gaps, p), -np.tanh(r / scale / 2) / scale, rtol=1e-6, atol=1e-6)
    assert noise.start(r, gaps)["noise_sd"] == pytest.approx(0.02, rel=0.06)  # five of its standard errors


def test_each_example_is_a_plug_in(tmp_path):
    """The base class determines the kind, also where it is defined in the `__init__` of its package."""
    for block in BLOCKS:
        use(tmp_path, block)
    assert "remark" in SECTIONS.added()
    with pytest.raises(bd.InputError, match="which is not a plug-in"):
        use(tmp_path, "class Other: name = 'other'\nPLUGIN = Other()\n")


@pytest.mark.slow
def test_all_kinds_in_one_study(tmp_path):
    assert len(BLOCKS) == 8
    for i, block in enumerate(BLOCKS):
        (tmp_path / f"own{i}.py").write_text(block, encoding="utf-8")
    files = ", ".join(f'"own{i}.py"' for i in range(len(BLOCKS)))
    out = tmp_path / "out"
    assert run_study(write_study(tmp_path, STUDY.replace("FILES", files)), out, workers=1) == 0
    estimates = {r["model"]: r for r in read_table(out / "estimates.csv")}
    assert estimates["viscous"]["value"] == pytest.approx(0.1, rel=0.1)
    assert estimates["cubic_drag"]["outcome"] == "it supports only viscous damping"
    posteriors = [r for r in read_table(out / "posteriors.csv") if r["sampler"] != "smc"]
    drawn = {r["parameter"]: r for r in posteriors if r["model"] == "viscous"}
    # four sds: a false alarm once in 16,000 seeds
    assert abs(drawn["zeta"]["mean"] - 0.1) < 4 * drawn["zeta"]["sd"]
    own = [r for r in posteriors if r["parameter"] == "drag3"]
    assert [r["unit"] for r in own] == ["s/rad²"]
    evidence = {r["model"]: r for r in read_table(out / "evidence.csv") if r["method"] != "smc"}
    assert evidence["viscous"]["method"] == "unit_information"
    assert evidence["cubic_drag"]["log_bayes_factor"] < -20
    assert evidence["thinning"]["outcome"] == evidence["rubbing"]["outcome"] == "ok"
    assert {"c_thinning", "thinning_velocity"} <= {
        r["parameter"] for r in posteriors if r["model"] == "thinning"
    }
    assert "Signals: rig" in (out / "report.html").read_text(encoding="utf-8")
