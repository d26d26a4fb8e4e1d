"""A study of repeats whose laws may hold approximately: joint fit, tables and what the report says."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline import run_study
from bayesdamp.store import Store, read_table
from bayesdamp.store.contents import JointContent
from tests.inference.deviation.drifts import CASES, SCALE, STIFFNESS, signals

pytestmark = pytest.mark.slow

STUDY = """
version = 1
name = "pair"
seed = 5
estimators = {{ use = ["least_squares"], stages = ["initial"] }}
models = {{ compare = ["viscous"], prior = {{ viscous = {{ prior = "halfnormal", scale = {scale} }} }} }}
posterior = {{ samplers = [], deviation = "{deviation}" }}
evidence = {{ methods = ["laplace"], referee = "never" }}
[system]
restoring = "linear"
stiffness = {stiffness}
rest_angle = 0.0
omega0 = 0.0
theta0 = "free"
{signals}
"""
SIGNAL = """
[[signal]]
name = "{name}"
specimen = "{specimen}"
file = "{name}.csv"
start = 0.0
stop = 20.0
"""


@lru_cache
def ran(deviation: str) -> Path:
    """Both pairs in one study. Not to be changed by a test."""
    folder, text = Path(mkdtemp()), ""
    for case in CASES:
        for j, signal in enumerate(signals(case)):
            name, specimen = f"{case[:3]}{j}", case[:3]
            record = np.column_stack([signal.t, signal.y])
            head = "time (s),angle (rad)"
            np.savetxt(folder / f"{name}.csv", record, delimiter=",", header=head, comments="")
            text += SIGNAL.format(name=name, specimen=specimen)
    whole = STUDY.format(stiffness=STIFFNESS, signals=text, scale=SCALE, deviation=deviation)
    (folder / "pair.toml").write_text(whole, encoding="utf-8")
    assert run_study(load_study(folder / "pair.toml"), folder / "out", workers=1) == 0
    return folder / "out"


def row(folder: Path, specimen: str) -> dict:
    (found,) = [
        r
        for r in read_table(folder / "specimens.csv")
        if (r["specimen"], r["record"], r["parameter"]) == (specimen, "", "zeta")
    ]
    return found


def joint(folder: Path, specimen: str) -> JointContent:
    return JointContent.of(Store(folder).read(f"joint/{specimen}"))


@pytest.mark.parametrize("deviation", ["law", "auto"])
def test_repeats_of_measured_records_are_joined_with_their_deviations(deviation: str) -> None:
    """Both records have one mean damping, which rises in the first where it falls in the other. Approximate laws leave
    one. Control: exact laws, whose noise takes up a part of the deviations, have the records differ."""
    found = row(ran(deviation), "rep")
    # Four sds: a false alarm once in 16,000 seeds.
    assert abs(found["mean"] - 0.05) < 4 * found["sd"]
    content = joint(ran(deviation), "rep")
    assert content.deviation == "law"
    assert not content.differ
    assert content.no_spread > 0
    exact = joint(ran("none"), "rep")
    assert exact.deviation == "none"
    assert exact.no_spread < content.no_spread - 1


def test_two_dampings_are_two() -> None:
    """One is twice the other."""
    content = joint(ran("law"), "two")
    assert content.differ
    assert content.no_spread < -3
    (own,) = [
        r for r in read_table(ran("law") / "population.csv") if r["of"] == "two1" and "repeats" in r["over"]
    ]
    assert abs(own["mean"] - 0.1) < 4 * own["sd"]
