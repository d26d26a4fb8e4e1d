"""The meaning of study files."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bayesdamp.config import Study, load_study
from bayesdamp.priors import HalfNormal
from tests.config.studies import FILE_SIGNAL, GOOD, SIGNAL, SYSTEM, write

STUDIES = Path(__file__).resolve().parents[2] / "studies"
PAGE = (STUDIES.parent / "docs" / "studies.md").read_text(encoding="utf-8")
FREE = SYSTEM.replace("omega0 = 0.0", 'omega0 = "free"') + FILE_SIGNAL
OWN_SYSTEM = 'system = { rest_angle = { prior = "normal", mean = 0, sd = 1 }, amplitude = 2, inertia = 3 }\n'
OWN_MODELS = 'compare = ["quadratic + viscous", "coulomb"]\nestimate = ["coulomb"]\n'
SWEEPS = """
[[sweep]]
key = "simulate.noise_sd"
values = [0.0, 0.003]
[[sweep]]
key = "simulate.viscous"
values = [0.1, 1e-5]
"""


def truths(study: Study, *names: str) -> list[tuple[Any, ...]]:
    """Return the signals' names and their true values."""
    return [(s.name, *(s.source.truth[name] for name in names)) for s in study.signals]  # type: ignore[union-attr]


MEANINGS: dict[str, tuple[str, Callable[[Study], Any], Any]] = {
    "defaults": (
        GOOD,
        lambda s: (s.name, s.models.compare, s.estimators.stages, s.posterior.samplers, s.evidence.methods),
        ("study", ("viscous", "coulomb", "quadratic"), ("initial", "refined"), ("nuts", "emcee"),
         ("importance", "bridge")),
    ),
    "known in a signal's own system": (
        f"version = 1\n{FREE}{OWN_SYSTEM}",
        lambda s: dict(s.signals[0].system.known), {"stiffness": 20.0, "theta0": 0.3},
    ),
    "scales of the system": (
        f"version = 1\n{FREE}{OWN_SYSTEM}",
        lambda s: (s.signals[0].system.amplitude, s.signals[0].system.frequency, s.signals[0].inertia),
        (2.0, None, 3.0),
    ),
    "parameters of a file are free by default": (
        f'version = 1\n[system]\nrestoring = "horizontal_pendulum"\n{FILE_SIGNAL}',
        lambda s: (dict(s.signals[0].system.known), set(s.signals[0].system.free)),
        ({}, {"stiffness", "gravity", "spring_angle", "theta0", "omega0", "noise_sd"}),
    ),
    "another law has none of the study's law's parameters": (
        GOOD.replace('"linear"', '"duffing"\ncubic = 1.0') + 'system = { restoring = "pendulum" }\n',
        lambda s: (s.signals[0].system.restoring, "cubic" in s.signals[0].system.known), ("pendulum", False),
    ),
    "truth given in simulate stays free": (
        GOOD.replace("theta0 = 0.3", 'theta0 = "free"').replace("viscous = 0.05", "viscous = 0.05, theta0 = 0.2"),
        lambda s: (s.signals[0].system.free["theta0"], truths(s, "theta0")), (None, [("one", 0.2)]),
    ),
    "a sweep repeats the signals that have the key": (
        GOOD + FILE_SIGNAL + SWEEPS, lambda s: [one.name for one in s.signals][-1:], ["rig"],
    ),
    "sweeps": (
        GOOD + SWEEPS, lambda s: truths(s, "noise_sd", "zeta"),
        [("one-noise_sd-0-viscous-0p1", 0, 0.1), ("one-noise_sd-0-viscous-1e-05", 0, 1e-5),
         ("one-noise_sd-0p003-viscous-0p1", 0.003, 0.1), ("one-noise_sd-0p003-viscous-1e-05", 0.003, 1e-5)],
    ),
    "a sweep of the system touches known and truth": (
        GOOD + '[[sweep]]\nkey = "system.rest_angle"\nvalues = [-0.1, 0.2]\n',
        lambda s: (truths(s, "rest_angle"), s.signals[1].system.known["rest_angle"]),
        ([("one-rest_angle-m0p1", -0.1), ("one-rest_angle-0p2", 0.2)], 0.2),
    ),
    "the documentation's example": (
        PAGE.split("```toml\n")[1].split("```")[0], lambda s: (s.name, s.noises),
        ("rig", ("correlated", "gaussian", "quantised", "student_t")),
    ),
    "a signal's own models": (
        "version = 1\n" + SYSTEM + SIGNAL + OWN_MODELS + SIGNAL.replace('"one"', '"two"'),
        lambda s: [(s.compare(signal), s.estimate(signal)) for signal in s.signals],
        [(("viscous+quadratic", "coulomb"), ("coulomb",)), (("viscous", "coulomb", "quadratic"),) * 2],
    ),
}  # fmt: skip
"""The text of a study, a function of the study, and its expected result."""


@pytest.mark.parametrize(("text", "look", "expected"), MEANINGS.values(), ids=MEANINGS)
def test_a_study_has_the_meaning_of_its_text(
    tmp_path: Path, text: str, look: Callable[[Study], Any], expected: Any
) -> None:
    assert look(load_study(write(tmp_path, text))) == expected


@pytest.mark.parametrize("name", ["quickstart", "paper"])
def test_the_shipped_studies_are_valid(name: str) -> None:
    study = load_study(STUDIES / f"{name}.toml")
    assert study.name == name
    assert study.signals


def test_a_study_is_frozen_and_is_written_as_json(tmp_path: Path) -> None:
    path = write(tmp_path, GOOD + '[models]\nprior = { viscous = { prior = "halfnormal", scale = 0.2 } }\n')
    study = load_study(path)
    with pytest.raises(dataclasses.FrozenInstanceError):
        study.seed = 3  # type: ignore[misc]
    resolved = json.dumps(study.resolved())
    assert json.loads(resolved)["models"]["prior"]["viscous"] == {"prior": "halfnormal", "scale": 0.2}
    assert str(tmp_path) not in resolved
    assert study.models.prior["viscous"] == HalfNormal(scale=0.2)


def test_a_byte_order_mark_and_windows_line_ends_are_allowed(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load_study(path).signals


def test_published_figures_are_read(tmp_path: Path) -> None:
    (tmp_path / "printed.csv").write_text("estimator,signal,error_pct,time\nenvelope,one,~0,2–5 s\n")
    study = load_study(write(tmp_path, GOOD.replace("version = 1", 'version = 1\npublished = "printed.csv"')))
    (row,) = study.published
    assert tuple(row.values()) == ("envelope", "one", "~0", "2–5 s")
