"""A study's posterior and evidence are those of the interface's functions on the same fit."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.config import Study
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.run import run_study
from bayesdamp.pipeline.tasks import task_seed
from bayesdamp.store import Store, read_table
from tests.studies import study_text, write_study

MODEL = "viscous+coulomb"
STUDY = study_text(
    "estimators = { use = [] }",
    f'models = {{ compare = ["{MODEL}"], prior = {{ coulomb = {{ prior = "halfnormal", scale = 0.02 }} }} }}',
    'posterior = { samplers = ["laplace"], deviation = "none", chains = 2, warmup = 10, draws = 50 }',
    "evidence = { methods = ['laplace'], referee = 'never' }",
    simulate="viscous = 0.05, theta0 = 0.3, omega0 = 0.0, epsilon = 0.05, duration = 6, samples = 200, noise_sd = 3e-3",
    system='restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = "free", epsilon = "free", '
    'noise_sd = "free", omega0 = { prior = "normal", mean = 0.0, sd = 0.5 }',
)


@lru_cache
def ran(deviation: str = "none") -> tuple[Study, StudyCandidate]:
    folder = Path(mkdtemp())
    study = write_study(folder, STUDY.replace('deviation = "none"', f'deviation = "{deviation}"'))
    assert run_study(study, folder / "out", workers=1, quiet=True) == 0
    return study, StudyCandidate(study, study.signals[0], 0, MODEL, Store(folder / "out"))


@pytest.mark.parametrize("deviation", ["none", "law"])
def test_the_evidence_and_the_draws_are_those_of_the_interface(deviation: str) -> None:
    """Negative controls: another seed gives other draws, and exact laws have another evidence."""
    study, branch = ran(deviation)
    weighed = branch.store.read(f"evidence/{branch.path}/laplace").meta["evidence"]
    assert bd.evidence(branch.fit, "laplace").log_evidence == weighed["log_evidence"]
    name = f"posterior/{branch.path}/laplace"
    drawn, seed = branch.store.read(name).arrays["draws"], task_seed(study, name) % 2**31
    rows = read_table(branch.store.folder / "posteriors.csv")
    row = next(r for r in rows if (r["sampler"], r["parameter"]) == ("laplace", "zeta"))
    assert row["deviation"] == deviation
    settings = {"chains": 2, "warmup": 10, "draws": 50}
    np.testing.assert_array_equal(bd.sample(branch.fit, "laplace", **settings, seed=seed).draws, drawn)
    assert not np.array_equal(bd.sample(branch.fit, "laplace", **settings, seed=seed + 1).draws, drawn)
    if deviation == "law":
        assert row["sd_noise"] ** 2 + row["sd_law"] ** 2 == pytest.approx(row["sd"] ** 2)
        assert bd.evidence(ran()[1].fit, "laplace").log_evidence != pytest.approx(
            weighed["log_evidence"], abs=0.1
        )


def test_a_model_has_what_the_study_states() -> None:
    """A prior of each kind, the default one of ε, and known values. The model alone gives the same target."""
    _, branch = ran()
    model = branch.specify("none")
    assert model.known == {"stiffness": 20.0, "rest_angle": 0.0}
    assert model.priors["mu_c"] == bd.HalfNormal(0.02)
    assert model.priors["omega0"] == bd.Normal(0.0, 0.5)
    alone = bd.fit(branch.record.signal, model).priors
    assert alone == branch.fit.priors
    assert set(alone) == {"zeta", "mu_c", "theta0", "omega0", "epsilon", "noise_sd"}
    assert set(branch.specify("law").priors) == {"mu_c", "omega0"}


DUFFING = STUDY.replace('"linear"', '"duffing"').replace("stiffness = 20.0", "stiffness = 20.0, cubic = 1.0")


@pytest.mark.parametrize(
    ("study_of", "damping", "key", "parameter"),
    [
        (STUDY, "viscous+stribeck", "static_excess", "static_excess"),
        (DUFFING, "viscous+cubic", "cubic", "mu_3"),
    ],
)
def test_a_prior_reaches_the_parameter_that_it_is_of(tmp_path, study_of, damping, key, parameter) -> None:
    """A spring's cubic, which is known here, is not the damping's."""
    study = write_study(tmp_path, study_of.replace(MODEL, damping).replace("coulomb =", f"{key} ="))
    model = StudyCandidate(study, study.signals[0], 0, damping, ran()[1].store).specify("none")
    assert model.priors[parameter] == bd.HalfNormal(0.02)
    assert parameter not in ran()[1].specify("none").priors  # control: a model without the term
    assert model.known.get("cubic") == (1.0 if key == "cubic" else None)
    assert "cubic" not in model.priors
