"""The examples of docs/extending.md work without changes, alone and all in one study."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.inference.noise import NOISES
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report.sections import SECTIONS
from bayesdamp.store.files import read_table
from tests.studies import SYSTEM, finish_study, study_text

PAGE = Path(__file__).parents[2] / "docs" / "extending.md"
BLOCKS: list[str] = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
STUDY = study_text(
    "plugins = { modules = [FILES] }",
    'estimators = { use = ["half_life"], stages = ["initial"] }',
    'models = { compare = ["viscous", "cubic_drag", "thinning", "rubbing"] }',
    'posterior = { samplers = ["independence"], noise = "logistic" }',
    'evidence = { methods = ["unit_information"], referee = "never" }',
    simulate="viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003",
    system=SYSTEM.replace("linear", "soft_spring"),
)


SAMPLED = study_text(
    'plugins = { modules = ["own.py"] }',
    "estimators = { use = [] }",
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["nuts", "independence", "apart"], noise = "gaussian", draws = 500 }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.1, stiffness = 20.0, duration = 10.0, samples = 200, noise_sd = 0.003",
    system=SYSTEM.replace("20.0", '"free"'),
)
APART = """
from dataclasses import replace

class Apart(Independence):
    name = "apart"

    def sample(self, target, mode, settings):
        posterior = super().sample(target, mode, settings)
        shift = 2.0 * posterior.draws.std((0, 1)) * np.arange(settings.chains)[:, None, None]
        return replace(posterior, draws=posterior.draws + shift)

PLUGINS.append(Apart())
"""
"""A sampler whose successive chains have means that are two standard deviations apart."""


def use(folder: Path, block: str) -> None:
    """Use a plug-in with this source."""
    (folder / "own.py").write_text(block, encoding="utf-8")
    use_modules(read_modules([folder / "own.py"]))


def test_a_reader_reads_its_files_by_their_content(tmp_path, capsys):
    """Control: without the reader the format is unknown."""
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


def test_a_noise_model_has_the_density_of_scipy(tmp_path):
    """The defaults of its base class give its slope, and a start near the truth."""
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


def test_each_example_is_recognised_as_a_plug_in(tmp_path):
    """The base class determines the kind, also if it is defined in the `__init__` of its package."""
    for block in BLOCKS:
        use(tmp_path, block)
    assert "remark" in SECTIONS.added()


def test_draws_of_a_sampler_are_summarised_and_judged(tmp_path):
    """Means agree with those of NUTS within four Monte Carlo errors: one false alarm in 16,000 seeds.
    Control: a sampler whose chains do not agree."""
    (block,) = [b for b in BLOCKS if "(Sampler)" in b]
    (tmp_path / "own.py").write_text(block + APART, encoding="utf-8")
    out = finish_study(tmp_path, SAMPLED)
    rows = {(r["sampler"], r["parameter"]): r for r in read_table(out / "posteriors.csv")}
    expected = {name: r for (sampler, name), r in rows.items() if sampler == "nuts"}
    assert {"zeta", "stiffness", "noise_sd"} <= set(expected)
    for name, row in expected.items():
        own = rows["independence", name]
        assert (own["outcome"], own["unit"]) == ("ok", row["unit"])
        error = math.hypot(*(r["sd"] / math.sqrt(r["ess_bulk"]) for r in (own, row)))
        assert abs(own["mean"] - row["mean"]) < 4 * error, name
    assert rows["apart", "zeta"]["outcome"].startswith("not converged: R-hat")


@pytest.mark.slow
def test_one_study_uses_all_kinds(tmp_path):
    """ζ is within four sds: one false alarm in 16,000 seeds."""
    assert len(BLOCKS) == 8
    for i, block in enumerate(BLOCKS):
        (tmp_path / f"own{i}.py").write_text(block, encoding="utf-8")
    files = ", ".join(f'"own{i}.py"' for i in range(len(BLOCKS)))
    out = finish_study(tmp_path, STUDY.replace("FILES", files))
    estimates = {r["model"]: r for r in read_table(out / "estimates.csv")}
    assert estimates["viscous"]["value"] == pytest.approx(0.1, rel=0.1)
    assert estimates["cubic_drag"]["outcome"] == "it supports only viscous damping"
    rows = [r for r in read_table(out / "posteriors.csv") if r["sampler"] != "smc"]
    posteriors = {(r["model"], r["parameter"]): r for r in rows}
    zeta = posteriors["viscous", "zeta"]
    assert abs(zeta["mean"] - 0.1) < 4 * zeta["sd"]
    assert posteriors["cubic_drag", "drag3"]["unit"] == "s/rad²"
    assert {("thinning", "c_thinning"), ("thinning", "thinning_velocity")} <= set(posteriors)
    evidence = {r["model"]: r for r in read_table(out / "evidence.csv") if r["method"] != "smc"}
    assert evidence["viscous"]["method"] == "unit_information"
    assert evidence["cubic_drag"]["log_bayes_factor"] < -20
    assert evidence["thinning"]["outcome"] == evidence["rubbing"]["outcome"] == "ok"
    assert "Signals: rig" in (out / "report.html").read_text(encoding="utf-8")
