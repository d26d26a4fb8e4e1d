"""The plots that a user of ArviZ reaches for, on our trees as they are, under approximate laws.

Without a backend: what a plot takes from a tree is all taken. ArviZ-plots 0.8, the last for Python 3.11, cannot be
imported beside matplotlib 3.11, which the lock therefore does not have.
"""

from __future__ import annotations

from types import ModuleType

import arviz_stats as az
import pytest

from tests.interface import test_deviation

PLOTS = (
    "plot_dist", "plot_ppc_dist", "plot_prior_posterior", "plot_rank", "plot_loo_pit",
)  # fmt: skip


@pytest.fixture(scope="module")
def azp() -> ModuleType:
    import arviz_plots

    return arviz_plots


def test_drawn_as_it_is(azp: ModuleType) -> None:
    data = test_deviation.posterior().data
    for name in PLOTS:
        drawn = getattr(azp, name)(data, backend="none")
        assert "zeta" in str(drawn.viz) or "record" in str(drawn.viz), name
    loo = az.loo(data, pointwise=True)
    assert 3 < loo.p < 10  # a regular model of six parameters: about six effective ones, within four sds
    assert azp.plot_khat(loo, backend="none") is not None
