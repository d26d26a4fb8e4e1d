"""Draws, their log likelihoods and priors, and their data for ArviZ."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.stats import halfnorm

import bayesdamp as bd
from bayesdamp.priors import SHARED_SCALES, SharedHalfNormal
from tests.interface.problems import fit, posterior, record

GROUPS = {
    "posterior", "prior", "posterior_predictive", "log_likelihood", "sample_stats", "observed_data", "constant_data",
}  # fmt: skip


@pytest.mark.parametrize(("sampler", "draws"), [("nuts", 30), ("emcee", 40)])
def test_the_number_of_draws_is_the_requested_one(sampler: str, draws: int) -> None:
    """Also if they are too few, which the outcome of NUTS says."""
    post = bd.sample(fit(), sampler, warmup=20, draws=draws)
    assert post.draws.shape[1] == post.log_likelihood.shape[1] == draws
    assert f": {len(post.draws)} chains of {draws} draws" in repr(post)
    assert (post.divergences is None) == (sampler == "emcee")
    assert sampler != "nuts" or post.outcome.startswith(("too few draws", "not converged"))


def test_pointwise_terms_sum_to_the_log_likelihood() -> None:
    """The noise is independent; the density is solved with shorter steps than the draws."""
    post = posterior()
    terms = post.data["log_likelihood"]["record"]
    assert terms.sum("time").values == pytest.approx(post.log_likelihood, abs=0.01)
    first = post.draws[0, 0]
    assert fit().density.log_likelihood(first) == pytest.approx(post.log_likelihood[0, 0], abs=1e-3)
    lp = post.data["sample_stats"]["lp"].values
    assert lp[0, 0] == pytest.approx(fit().density.log_posterior(first), abs=1e-3)


def test_the_prior_of_two_terms_has_one_scale() -> None:
    """The expected log prior is computed from half-normal densities, averaged over the scales that terms share."""
    post = bd.sample(bd.fit(record(), bd.Model("viscous+quadratic", "linear")), warmup=20, draws=10)
    priors = post.fit.priors
    terms = [n for n, p in priors.items() if isinstance(p, SharedHalfNormal)]
    draws = {n: post.draws[..., i] for i, n in enumerate(post.names)}
    each = [halfnorm.pdf(draws[n][..., None], scale=SHARED_SCALES * priors[n].per_ratio) for n in terms]
    shared = np.prod(each, axis=0)
    others = sum(priors[n].log_density(x) for n, x in draws.items() if n not in terms)
    assert len(terms) == 2
    assert post.log_prior == pytest.approx(np.log(shared.mean(axis=-1)) + others)


def test_predicted_records_have_the_noise_of_the_record() -> None:
    """The sd of 300,000 numbers about the motion is that of the noise; the spread of the parameters adds about 2 %."""
    predicted = posterior().data["posterior_predictive"]["record"]
    scatter = float((predicted - predicted.mean(("chain", "draw"))).std())
    assert scatter == pytest.approx(float(posterior().data["posterior"]["noise_sd"].mean()), rel=0.05)


def test_draws_are_saved_and_written_as_netcdf(tmp_path: Path) -> None:
    loaded = bd.Posterior.load(posterior().save(tmp_path / "post"))
    assert np.array_equal(loaded.draws, posterior().draws)
    assert repr(loaded) == repr(posterior())
    name, *sizes, _ = repr(loaded).splitlines()[2].split()
    row = posterior().summary().loc[name, ["mean", "sd", "q2.5", "q97.5", "ess_bulk", "rhat"]]
    assert [float(size) for size in sizes] == pytest.approx(row.to_list(), rel=1e-4)
    terms, expected = (post.data["log_likelihood"]["record"].values for post in (loaded, posterior()))
    assert np.array_equal(terms, expected)
    posterior().data.to_netcdf(tmp_path / "post.nc", engine="h5netcdf")
    with xr.open_datatree(tmp_path / "post.nc", engine="h5netcdf") as read:
        assert set(read.children) == GROUPS
        assert read["posterior"]["zeta"].attrs["units"] == "1/s"
        assert read["observed_data"]["record"].values == pytest.approx(record().y)
