"""ArviZ's usual plots of the data of a posterior under approximate laws.

They are made without a backend, which reads all data that a plot needs. ArviZ-plots 0.8, the last version for Python
3.11, cannot be imported with matplotlib 3.11, which `constraints.txt` therefore excludes.
"""

import arviz_stats as az

from tests.interface import test_deviation

PLOTS = (
    "plot_dist", "plot_ppc_dist", "plot_prior_posterior", "plot_rank", "plot_loo_pit",
)  # fmt: skip


def test_plots_and_loo_need_no_conversion() -> None:
    import arviz_plots as azp

    data = test_deviation.posterior().data
    for name in PLOTS:
        plot = getattr(azp, name)(data, backend="none")
        assert "zeta" in str(plot.viz) or "record" in str(plot.viz), name
    loo = az.loo(data, pointwise=True)
    assert 3 < loo.p < 10  # a regular model of six parameters: about six effective ones, within four sds
    assert azp.plot_khat(loo, backend="none") is not None
