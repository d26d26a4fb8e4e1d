"""A study whose laws may hold approximately: its chains and evidence against Python's call, a sum over the parameter,
and the linear model's interval."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.config import load_study
from bayesdamp.pipeline import run_study
from bayesdamp.report.results.checks import Checks
from bayesdamp.report.results.run import RunFolder
from bayesdamp.store import read_table
from tests.interface.test_chains import by_sum
from tests.interface.test_deviation import (
    DRIFT,
    KNOTS,
    KNOWN,
    LONG,
    NOISE,
    SCALE,
    drifting,
    motion,
    one_parameter,
)

STUDY = """
version = 1
name = "drift"
seed = 5
estimators = {{ use = ["least_squares"], stages = ["initial"] }}
models = {{ compare = ["viscous"], prior = {{ viscous = {{ prior = "halfnormal", scale = {scale} }} }} }}
posterior = {{ samplers = {samplers}, deviation = "{deviation}", chains = 2, draws = 1400 }}
evidence = {{ methods = ["laplace", "importance", "bridge"], referee = "never" }}
[system]
restoring = "linear"
{known}
[[signal]]
name = "drift"
file = "drift.csv"
start = 0.0
stop = 20.0
"""


def swelling() -> bd.Signal:
    """Viscous damping that rises and falls by 15 %, once: what no power of the velocity does."""
    g = DRIFT * np.sin(np.linspace(0.0, 2 * np.pi, KNOTS.size))
    noise = NOISE * np.random.default_rng(8).standard_normal(LONG.size)
    return bd.signal(LONG, motion(0.05, g, 0 * g) + noise, name="swell", cleaned=False)


@lru_cache
def ran(deviation: str, samplers: str = '["nuts"]', swells: bool = False) -> Path:
    folder = Path(mkdtemp())
    signal = swelling() if swells else drifting()
    record = np.column_stack([signal.t, signal.y])
    np.savetxt(folder / "drift.csv", record, delimiter=",", header="time (s),angle (rad)", comments="")
    known = "\n".join(f"{n} = {v}" for n, v in KNOWN.items())
    text = STUDY.format(known=known, scale=SCALE, deviation=deviation, samplers=samplers)
    (folder / "drift.toml").write_text(text, encoding="utf-8")
    assert run_study(load_study(folder / "drift.toml"), folder / "out", workers=1) == 0
    return folder / "out"


def zeta(folder: Path, sampler: str = "nuts") -> dict:
    rows = read_table(folder / "posteriors.csv")
    return next(r for r in rows if (r["sampler"], r["parameter"]) == (sampler, "zeta"))


def test_chains_are_those_of_the_total_interval() -> None:
    """NUTS against a sum over ζ, within five standard errors of the effective draws; its interval is the linear model's
    to a fifth of its width. Controls: noise alone is narrower, and so is the study that takes laws to hold exactly."""
    row, (mean, sd, _) = zeta(ran("law")), by_sum()
    error = sd / np.sqrt(row["ess_bulk"])
    assert abs(row["mean"] - mean) < 5 * error
    assert abs(row["sd"] - sd) < 5 * error
    low, high = one_parameter().intervals["zeta"]
    assert row["q2.5"] == pytest.approx(low, abs=0.2 * (high - low))
    assert row["q97.5"] == pytest.approx(high, abs=0.2 * (high - low))
    assert row["deviation"] == "law"
    assert row["sd_noise"] ** 2 + row["sd_law"] ** 2 == pytest.approx(row["sd"] ** 2)
    exact = zeta(ran("none"))
    assert exact["deviation"] == "none"
    assert exact["sd"] < 0.75 * row["sd"]
    assert row["sd_noise"] < 0.75 * row["sd"]


def test_evidence_is_that_of_the_same_density() -> None:
    """Within four standard errors of a sum over ζ, the linear model's to 0.1 nats, which curvature is worth.
    Control: under exact laws it is nats behind."""
    rows = {r["method"]: r for r in read_table(ran("law") / "evidence.csv")}
    total = by_sum()[2]
    for method in ("importance", "bridge"):
        assert rows[method]["deviation"] == "law"
        assert abs(rows[method]["log_evidence"] - total) < 4 * rows[method]["stderr"] + 1e-3
    assert rows["importance"]["outcome"] == "ok"
    assert abs(rows["laplace"]["log_evidence"] - total) < 0.1
    exact = {r["method"]: r for r in read_table(ran("none") / "evidence.csv")}
    assert {r["deviation"] for r in exact.values()} == {"none"}
    assert total - exact["importance"]["log_evidence"] > 5


@pytest.mark.slow
def test_the_page_says_whether_chains_confirm() -> None:
    """Controls: a folder of the same name whose laws held exactly says something else, and so does one whose answer is
    rather another form than what the chains sampled."""
    page = (ran("law", swells=True) / "report.html").read_text(encoding="utf-8")
    assert "NUTS confirms the damping ratio: " in checked(ran("law", swells=True))
    assert "residual checks assume that the laws hold exactly" not in page
    assert "Other noise models are not computed" in page
    assert "are not computed" not in (ran("none") / "report.html").read_text(encoding="utf-8")
    assert "NUTS sampled viscous damping alone, which has probability 0.06" in checked(ran("law"))


def checked(folder: Path) -> str:
    """The checks of the answer on the page."""
    return " ".join(check.text for check in Checks(RunFolder(folder), "drift").all())


@pytest.mark.slow
def test_auto_says_which_likelihood_each_row_has() -> None:
    """Of a measured record the answer's draws have the deviations, the chains not."""
    folder = ran("auto", '["nuts", "laplace"]', swells=True)
    rows = read_table(folder / "posteriors.csv")
    assert {(r["sampler"], r["deviation"]) for r in rows} == {
        ("nuts", "none"),
        ("laplace", "none"),
        ("smc", "law"),
    }


@pytest.mark.slow
def test_what_takes_laws_to_hold_exactly_says_so(tmp_path: Path) -> None:
    rows = read_table(ran("law", '["kalman", "emcee"]') / "posteriors.csv")
    refused = [r["outcome"] for r in rows if r["sampler"] == "kalman"]
    assert len(refused) == 1
    assert "assumes that laws hold exactly" in refused[0]
    assert zeta(ran("law", '["kalman", "emcee"]'), "emcee")["sd"] == pytest.approx(by_sum()[1], rel=0.15)
