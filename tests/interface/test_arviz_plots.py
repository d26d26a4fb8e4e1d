"""The plots that a user of ArviZ reaches for, on our trees as they are, under exact and approximate laws.

Without a backend: what a plot takes from a tree is all taken. ArviZ-plots 0.8, the last for Python 3.11, cannot be
imported beside matplotlib 3.11, which the lock therefore does not have.
"""

from __future__ import annotations

from types import ModuleType

import arviz_stats as az
import pytest

from tests.interface import test_deviation
from tests.interface.problems import posterior

PLOTS = (
    "plot_dist", "plot_ppc_dist", "plot_prior_posterior", "plot_rank", "plot_loo_pit",
)  # fmt: skip
DRAWN = {"exact": posterior, "law": test_deviation.posterior}


@pytest.fixture(scope="module")
def azp() -> ModuleType:
    import arviz_plots

    return arviz_plots


@pytest.mark.parametrize("laws", ["law", pytest.param("exact", marks=pytest.mark.slow)])
def test_drawn_as_it_is(azp: ModuleType, laws: str) -> None:
    data = DRAWN[laws]().data
    for name in PLOTS:
        drawn = getattr(azp, name)(data, backend="none")
        assert "zeta" in str(drawn.viz) or "record" in str(drawn.viz), name
    loo = az.loo(data, pointwise=True)
    assert 3 < loo.p < 10  # a regular model of six parameters: about six effective ones, within four sds
    assert azp.plot_khat(loo, backend="none") is not None


def test_without_a_group_there_is_no_plot(azp: ModuleType) -> None:
    """The control: what these tests call does read the groups."""
    tree = posterior().data.copy()
    del tree["posterior_predictive"]
    with pytest.raises(KeyError, match="posterior_predictive"):
        azp.plot_ppc_dist(tree, backend="none")


def test_summaries_are_ours() -> None:
    post = posterior()
    theirs = az.summary(post.data, round_to="none")
    ours = post.summary(derived=False)
    for name in post.names:
        assert theirs.loc[name, "mean"] == pytest.approx(ours.loc[name, "mean"], rel=1e-6, abs=1e-9)
        assert theirs.loc[name, "r_hat"] == pytest.approx(ours.loc[name, "rhat"], abs=1e-6)
