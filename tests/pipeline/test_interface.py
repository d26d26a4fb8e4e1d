"""A study's posterior and evidence are those of the interface's functions on the same fit."""

from functools import lru_cache, partial
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.config import Study
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.run import run_study
from bayesdamp.pipeline.tasks import task_seed
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.studies import study_text, write_study

MODEL = "viscous+coulomb"
STUDY = study_text(
    "estimators = { use = [] }",
    f'models = {{ compare = ["{MODEL}"], prior = {{ coulomb = {{ prior = "halfnormal", scale = 0.02 }} }} }}',
    'posterior = { samplers = ["nuts"], deviation = "none", chains = 2, warmup = 10, draws = 50 }',
    "evidence = { methods = ['laplace'], referee = 'never' }",
    simulate="viscous = 0.05, theta0 = 0.3, omega0 = 0.0, epsilon = 0.05, duration = 6, samples = 200, noise_sd = 3e-3",
    system='restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = "free", epsilon = "free", '
    'noise_sd = "free", omega0 = { prior = "normal", mean = 0.0, sd = 0.5 }',
)


@lru_cache
def finished(deviation: str = "none") -> tuple[Study, StudyCandidate]:
    """Run the study, and return it with its candidate."""
    folder = Path(mkdtemp())
    study = write_study(folder, STUDY.replace('deviation = "none"', f'deviation = "{deviation}"'))
    assert run_study(study, folder / "out", workers=1, quiet=True) == 0
    return study, StudyCandidate(study, study.signals[0], 0, MODEL, Store(folder / "out"))


@pytest.mark.parametrize("deviation", ["none", "law"])
def test_the_evidence_and_the_draws_are_those_of_the_interface(deviation: str) -> None:
    """Controls: another seed gives other draws, and exact laws have another evidence."""
    study, candidate = finished(deviation)
    evidence = candidate.store.read(f"evidence/{candidate.path}/laplace").meta["evidence"]["log_evidence"]
    assert bd.evidence(candidate.fit, "laplace").log_evidence == evidence
    name = f"posterior/{candidate.path}/nuts"
    seed = task_seed(study, name) % 2**31
    draws = candidate.store.read(name).arrays["draws"][:, :50]  # a study adds draws to too few ones
    rows = read_table(candidate.store.folder / "posteriors.csv")
    row = next(r for r in rows if (r["sampler"], r["parameter"]) == ("nuts", "zeta"))
    assert row["deviation"] == deviation
    sample = partial(bd.sample, candidate.fit, "nuts", chains=2, warmup=10, draws=50)
    np.testing.assert_array_equal(sample(seed=seed).draws, draws)
    assert not np.array_equal(sample(seed=seed + 1).draws, draws)
    if deviation == "law":
        assert row["sd_noise"] ** 2 + row["sd_law"] ** 2 == pytest.approx(row["sd"] ** 2)
        assert bd.evidence(finished()[1].fit, "laplace").log_evidence != pytest.approx(evidence, abs=0.1)


def test_a_candidate_s_model_has_the_priors_and_known_values_of_the_study() -> None:
    """A fit of this model alone has the same priors, also the default prior of ε."""
    _, candidate = finished()
    model = candidate.specify("none")
    assert model.known == {"stiffness": 20.0, "rest_angle": 0.0}
    assert model.priors["mu_c"] == bd.HalfNormal(0.02)
    assert model.priors["omega0"] == bd.Normal(0.0, 0.5)
    priors = bd.fit(candidate.record.signal, model).priors
    assert priors == candidate.fit.priors
    assert set(priors) == {"zeta", "mu_c", "theta0", "omega0", "epsilon", "noise_sd"}
    assert set(candidate.specify("law").priors) == {"mu_c", "omega0"}


DUFFING = STUDY.replace('"linear"', '"duffing"').replace("stiffness = 20.0", "stiffness = 20.0, cubic = 1.0")


@pytest.mark.parametrize(
    ("text", "damping", "key", "parameter"),
    [
        (STUDY, "viscous+stribeck", "static_excess", "static_excess"),
        (DUFFING, "viscous+cubic", "cubic", "mu_3"),
    ],
)
def test_a_prior_is_that_of_the_parameter_that_its_key_names(tmp_path, text, damping, key, parameter) -> None:
    """The cubic stiffness, which is known here, is not the coefficient of cubic damping."""
    study = write_study(tmp_path, text.replace(MODEL, damping).replace("coulomb =", f"{key} ="))
    model = StudyCandidate(study, study.signals[0], 0, damping, finished()[1].store).specify("none")
    assert model.priors[parameter] == bd.HalfNormal(0.02)
    assert parameter not in finished()[1].specify("none").priors  # control: a model without the term
    assert model.known.get("cubic") == (1.0 if key == "cubic" else None)
    assert "cubic" not in model.priors
