"""Fast answers and the online filter in a study: their rows, their refusals, their figure."""

from __future__ import annotations

import math

import pytest

from bayesdamp.inference.samplers import SAMPLERS, Sampler
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store, read_table
from bayesdamp.types import Refusal
from tests.studies import SYSTEM, study_text, write_study

STUDY = study_text(
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["laplace", "kalman", "refusing"], draws = 500 }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003",
    name="noisy",
    system=f"{SYSTEM}, inertia = 0.7",
)


class Refusing(Sampler):
    name = "refusing"

    def sample(self, target, mode, settings):
        raise Refusal("it does not want to")


@pytest.fixture
def refusing():
    SAMPLERS.add("refusing", Refusing())
    yield
    SAMPLERS.remove("refusing")


def test_rows_refusals_and_the_running_estimate(tmp_path, refusing):
    assert run_study(write_study(tmp_path, STUDY), tmp_path / "out", workers=1) == 0
    rows = read_table(tmp_path / "out" / "posteriors.csv")
    for sampler in ("laplace", "kalman"):
        found = {r["parameter"]: r for r in rows if r["sampler"] == sampler and r["model"] == "viscous"}
        zeta = found["zeta"]
        # four posterior sds: a false alarm once in 16,000 seeds
        assert abs(zeta["mean"] - 0.05) < 4 * zeta["sd"]
        assert zeta["q2.5"] == pytest.approx(zeta["mean"] - 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
        assert zeta["q97.5"] == pytest.approx(zeta["mean"] + 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
        assert (zeta["outcome"], zeta["divergences"]) == ("ok", 0)
        assert zeta["ess_bulk"] > 1000
        assert math.isnan(zeta["rhat"])
        assert abs(found["half_life"]["median"] - math.log(2) / zeta["median"]) < 1e-6
        assert abs(found["viscous_coefficient"]["mean"] - 1.4 * zeta["mean"]) < 1e-12
        assert (found["viscous_coefficient"]["unit"], found["energy_lost"]["unit"]) == ("N m s", "J")
    refused = [r for r in rows if r["sampler"] == "refusing"]
    assert [r["outcome"] for r in refused] == ["it does not want to"]
    cell = Store(tmp_path / "out").read("posterior/noisy/0/viscous/kalman")
    assert cell.arrays["curve/log_decrement"].shape == (3, cell.arrays["amplitudes"].size)
    assert cell.arrays["running/restarted/mean"].shape == (200, 1)
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'id="running"' in report
    assert (tmp_path / "out" / "figures" / "running-noisy-viscous.svg").exists()
