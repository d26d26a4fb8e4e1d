"""What a study file means."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from bayesdamp.config import Simulation, load_study
from bayesdamp.priors import HalfNormal, Normal
from tests.config.studies import FILE_SIGNAL, GOOD, SIGNAL, SYSTEM, write

STUDIES = Path(__file__).resolve().parents[2] / "studies"


def test_a_small_study_has_the_defaults(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD))
    assert study.name == "study"
    assert study.models.compare == ("viscous", "coulomb", "quadratic")
    assert study.estimators.stages == ("initial", "refined")
    assert study.posterior.samplers == ("nuts", "emcee")
    assert (study.posterior.chains, study.posterior.warmup, study.posterior.draws) == (4, 500, 1000)
    assert study.evidence.methods == ("importance", "bridge")
    assert study.evidence.referee == "auto"
    (one,) = study.signals
    assert dict(one.system.known) == {"stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
    assert dict(one.system.free) == {"noise_sd": None}
    assert one.source.damping == ("viscous",)
    assert one.source.truth["zeta"] == 0.05
    assert one.source.truth["noise_sd"] == 0.003


def test_the_studies_that_ship_load() -> None:
    for name in ("quickstart", "paper"):
        study = load_study(STUDIES / f"{name}.toml")
        assert study.name == name
        assert study.signals


def test_a_study_is_frozen_and_writes_itself_as_json(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD + '[models]\nprior = { viscous = { prior = "halfnormal", scale = 0.2 } }\n')
    study = load_study(path)
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.seed = 3  # type: ignore[misc]
    resolved = json.loads(json.dumps(study.resolved()))
    assert resolved["models"]["prior"]["viscous"] == {"prior": "halfnormal", "scale": 0.2}
    assert str(tmp_path) not in json.dumps(resolved)
    assert study.models.prior["viscous"] == HalfNormal(scale=0.2)


def test_system_values_are_known_free_or_with_a_prior(tmp_path: Path) -> None:
    text = "version = 1\n" + SYSTEM.replace("omega0 = 0.0", 'omega0 = "free"') + FILE_SIGNAL
    text += (
        'system = { rest_angle = { prior = "normal", mean = 0.1, sd = 1 }, amplitude = 2.0, inertia = 3 }\n'
    )
    (rig,) = load_study(write(tmp_path, text)).signals
    assert dict(rig.system.known) == {"stiffness": 20.0, "theta0": 0.3}
    assert dict(rig.system.free) == {
        "rest_angle": Normal(mean=0.1, sd=1),
        "omega0": None,
        "noise_sd": None,
    }
    assert (rig.system.amplitude, rig.system.frequency, rig.inertia) == (2.0, None, 3.0)


def test_what_is_not_mentioned_is_free_for_a_file(tmp_path: Path) -> None:
    text = 'version = 1\n[system]\nrestoring = "horizontal_pendulum"\n' + FILE_SIGNAL
    (rig,) = load_study(write(tmp_path, text)).signals
    assert not rig.system.known
    assert set(rig.system.free) == {"stiffness", "gravity", "spring_angle", "theta0", "omega0", "noise_sd"}
    assert rig.source.path == (tmp_path / "rig.csv").resolve()


def test_another_law_drops_the_study_s_parameters_that_it_does_not_have(tmp_path: Path) -> None:
    text = GOOD.replace('"linear"', '"duffing"\ncubic = 1.0') + 'system = { restoring = "pendulum" }\n'
    (one,) = load_study(write(tmp_path, text)).signals
    assert one.system.restoring == "pendulum"
    assert "cubic" not in one.system.known


def test_truth_given_in_simulate_stays_free(tmp_path: Path) -> None:
    text = GOOD.replace("theta0 = 0.3", 'theta0 = "free"').replace(
        "viscous = 0.05", "viscous = 0.05, theta0 = 0.2"
    )
    (one,) = load_study(write(tmp_path, text)).signals
    assert one.system.free["theta0"] is None
    assert one.source.truth["theta0"] == 0.2


def test_a_sweep_repeats_the_signals_that_have_the_key(tmp_path: Path) -> None:
    sweeps = """
[[sweep]]
key = "simulate.noise_sd"
values = [0.0, 0.003]
[[sweep]]
key = "simulate.viscous"
values = [0.1, 1e-5]
"""
    study = load_study(write(tmp_path, GOOD + FILE_SIGNAL + sweeps))
    assert [s.name for s in study.signals] == [
        "one-noise_sd-0-viscous-0p1",
        "one-noise_sd-0-viscous-1e-05",
        "one-noise_sd-0p003-viscous-0p1",
        "one-noise_sd-0p003-viscous-1e-05",
        "rig",
    ]
    truths = [s.source.truth for s in study.signals if isinstance(s.source, Simulation)]
    assert [(t["noise_sd"], t["zeta"]) for t in truths] == [(0, 0.1), (0, 1e-5), (0.003, 0.1), (0.003, 1e-5)]


def test_a_sweep_of_the_system_touches_known_and_truth(tmp_path: Path) -> None:
    text = GOOD + '[[sweep]]\nkey = "system.rest_angle"\nvalues = [-0.1, 0.2]\n'
    low, high = load_study(write(tmp_path, text)).signals
    assert low.name == "one-rest_angle-m0p1"
    assert high.system.known["rest_angle"] == 0.2
    assert high.source.truth["rest_angle"] == 0.2


def test_models_have_one_spelling_and_all_is_seven(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + '[models]\ncompare = ["coulomb + viscous"]\n'))
    assert study.models.compare == ("viscous+coulomb",)
    assert len(load_study(write(tmp_path, GOOD + '[models]\ncompare = "all"\n')).models.compare) == 7


def test_an_empty_list_switches_a_stage_off(tmp_path: Path) -> None:
    text = GOOD + "[estimators]\nuse = []\n[posterior]\nsamplers = []\n[evidence]\nmethods = []\n"
    study = load_study(write(tmp_path, text))
    assert (study.estimators.use, study.posterior.samplers, study.evidence.methods) == ((), (), ())


def test_a_byte_order_mark_and_windows_line_ends_are_no_fault(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load_study(path).signals


def test_the_example_of_the_documentation_loads(tmp_path: Path) -> None:
    page = (STUDIES.parent / "docs" / "studies.md").read_text(encoding="utf-8")
    example = page.split("```toml\n")[1].split("```")[0]
    study = load_study(write(tmp_path, example))
    assert study.name == "rig"
    assert study.posterior.noise == "auto"


def test_a_signal_has_models_of_its_own(tmp_path: Path) -> None:
    other = SIGNAL.replace('"one"', '"two"')
    own = SIGNAL + 'compare = ["quadratic+viscous", "coulomb"]\nestimate = ["coulomb"]\n'
    study = load_study(write(tmp_path, "version = 1\n" + SYSTEM + own + other))
    first, second = study.signals
    assert study.compare(first) == ("viscous+quadratic", "coulomb")
    assert study.estimate(first) == ("coulomb",)
    assert study.compare(second) == study.estimate(second) == ("viscous", "coulomb", "quadratic")


def test_published_figures_are_read(tmp_path: Path) -> None:
    (tmp_path / "printed.csv").write_text("estimator,signal,error_pct,time\nenvelope,one,~0,2–5 s\n")
    study = load_study(write(tmp_path, GOOD.replace("version = 1", 'version = 1\npublished = "printed.csv"')))
    (row,) = study.published
    assert (row.estimator, row.signal, row.error_pct, row.time) == ("envelope", "one", "~0", "2–5 s")
