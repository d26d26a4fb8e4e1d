"""A study's posterior with its derived quantities, and a sampler that refuses."""

from __future__ import annotations

import math

import pytest
import xarray as xr

from bayesdamp.inference.samplers import SAMPLERS, Sampler
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import read_table
from bayesdamp.types import Refusal
from tests.studies import SYSTEM, study_text, write_study

STUDY = study_text(
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["nuts", "refusing"], draws = 500 }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003",
    name="noisy",
    system=f"{SYSTEM}, inertia = 0.7",
)


class Refusing(Sampler):
    name = "refusing"

    def sample(self, target, mode, settings):
        raise Refusal("it does not support this record")


def test_a_posterior_has_derived_quantities_and_a_refusal_its_reason(tmp_path):
    """The truth is within four posterior sds: one false alarm in 16,000 seeds."""
    SAMPLERS.add("refusing", Refusing())
    try:
        assert run_study(write_study(tmp_path, STUDY), tmp_path / "out", workers=1) == 0
    finally:
        SAMPLERS.remove("refusing")
    rows = read_table(tmp_path / "out" / "posteriors.csv")
    parameters = {r["parameter"]: r for r in rows if r["sampler"] == "nuts" and r["model"] == "viscous"}
    zeta = parameters["zeta"]
    assert abs(zeta["mean"] - 0.05) < 4 * zeta["sd"]
    assert zeta["q2.5"] == pytest.approx(zeta["mean"] - 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
    assert zeta["q97.5"] == pytest.approx(zeta["mean"] + 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
    assert (zeta["outcome"], zeta["divergences"]) == ("ok", 0)
    coefficient = parameters["viscous_coefficient"]
    assert abs(parameters["half_life"]["median"] - math.log(2) / zeta["median"]) < 1e-6
    assert abs(coefficient["mean"] - 1.4 * zeta["mean"]) < 1e-12
    assert (coefficient["unit"], parameters["energy_lost"]["unit"]) == ("N m s", "J")
    with xr.open_datatree(
        tmp_path / "out" / "posterior" / "noisy.0.viscous.nuts.nc", engine="h5netcdf"
    ) as tree:
        assert {"posterior", "prior", "posterior_predictive", "log_likelihood", "observed_data"} <= set(
            tree.children
        )
        assert tree["posterior"]["zeta"].mean() == pytest.approx(zeta["mean"])
        assert tree["posterior"]["zeta"].attrs["units"] == "1/s"
    outcomes = [r["outcome"] for r in rows if r["sampler"] == "refusing"]
    assert outcomes == ["it does not support this record"]
