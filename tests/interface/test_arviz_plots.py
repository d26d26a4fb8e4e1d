"""The plots that a user of ArviZ reaches for, on our trees as they are, under exact and approximate laws."""

from __future__ import annotations

import arviz_plots as azp
import arviz_stats as az
import matplotlib.pyplot as plt
import pytest
import xarray as xr

import bayesdamp as bd
from tests.interface import test_deviation
from tests.interface.problems import posterior

PLOTS = (
    "plot_trace",
    "plot_dist",
    "plot_ppc_dist",
    "plot_forest",
    "plot_prior_posterior",
    "plot_rank",
    "plot_ess",
)
DRAWN = {"exact": posterior, "law": test_deviation.posterior}


@pytest.mark.parametrize("laws", list(DRAWN))
@pytest.mark.parametrize("name", PLOTS)
def test_drawn_as_it_is(name: str, laws: str) -> None:
    drawn = getattr(azp, name)(DRAWN[laws]().data)
    assert plt.get_fignums(), "nothing was drawn"
    assert "figure" in drawn.viz
    plt.close("all")


@pytest.mark.parametrize("laws", list(DRAWN))
def test_leave_one_out_is_drawn(laws: str) -> None:
    tree = DRAWN[laws]().data
    azp.plot_khat(az.loo(tree, pointwise=True))
    azp.plot_loo_pit(tree)
    plt.close("all")


def test_without_a_group_there_is_no_plot() -> None:
    """The control: what these tests call does read the groups."""
    tree: xr.DataTree = posterior().data.copy()
    del tree["posterior_predictive"]
    with pytest.raises(KeyError, match="posterior_predictive"):
        azp.plot_ppc_dist(tree)


@pytest.mark.parametrize("laws", list(DRAWN))
def test_summaries_are_ours(laws: str) -> None:
    post: bd.Posterior = DRAWN[laws]()
    theirs = az.summary(post.data, round_to="none")
    ours = post.summary(derived=False)
    for name in post.names:
        assert theirs.loc[name, "mean"] == pytest.approx(ours.loc[name, "mean"], rel=1e-6, abs=1e-9)
        assert theirs.loc[name, "r_hat"] == pytest.approx(ours.loc[name, "rhat"], abs=1e-6)
