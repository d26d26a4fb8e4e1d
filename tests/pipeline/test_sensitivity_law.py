"""A study whose laws may hold approximately: what its evidence depends on, by halves, by Savage and Dickey, by nested
sampling; in its store and on its page."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from scipy.stats import gaussian_kde

from bayesdamp.config import load_study
from bayesdamp.inference.evidence.sensitivity import FARTHEST
from bayesdamp.pipeline import run_study
from bayesdamp.store import Store, read_table
from tests.interface.test_deviation import KNOWN
from tests.pipeline.test_study_deviation import swelling

pytestmark = pytest.mark.slow

SMALL, LARGE = "viscous", "viscous+coulomb"
STUDY = """
version = 1
name = "halves"
seed = 5
estimators = {{ use = ["least_squares"], stages = ["initial"] }}
posterior = {{ samplers = ["nuts"], deviation = "law", chains = 3, draws = 3000 }}
evidence = {{ methods = ["laplace", "importance"] }}
[system]
restoring = "linear"
{known}
[models]
compare = ["viscous", "viscous+coulomb"]
prior = {{ viscous = {{ prior = "halfnormal", scale = 0.2 }}, coulomb = {{ prior = "halfnormal", scale = 0.005 }} }}
[[signal]]
name = "swell"
file = "swell.csv"
start = 0.0
stop = 20.0
"""


@lru_cache
def ran() -> Path:
    folder = Path(mkdtemp())
    record = np.column_stack([swelling().t, swelling().y])
    np.savetxt(folder / "swell.csv", record, delimiter=",", header="time (s),angle (rad)", comments="")
    known = "\n".join(f"{n} = {v}" for n, v in KNOWN.items())
    (folder / "halves.toml").write_text(STUDY.format(known=known), encoding="utf-8")
    assert run_study(load_study(folder / "halves.toml"), folder / "out", workers=1) == 0
    return folder / "out"


def weighed(model: str, method: str) -> dict:
    rows = read_table(ran() / "evidence.csv")
    return next(r for r in rows if (r["model"], r["method"]) == (model, method))


def of(model: str, kind: str):
    return Store(ran()).read(f"sensitivity/swell/0/{model}/{kind}")


def test_savage_and_dickey_s_ratio_is_the_evidence_s_difference() -> None:
    """Of viscous damping to that with friction: within four standard errors and 0.1 nats, which deviations linear about
    two motions are worth. Control: a density that does not know where the axis ends loses log 2."""
    ratio = of(LARGE, "savage_dickey").meta["against"][SMALL]
    difference = weighed(SMALL, "importance")["log_evidence"] - weighed(LARGE, "importance")["log_evidence"]
    errors = [ratio["stderr"], weighed(SMALL, "importance")["stderr"], weighed(LARGE, "importance")["stderr"]]
    limit = 4 * float(np.linalg.norm(errors)) + 0.1
    assert ratio["outcome"] == "ok"
    assert abs(difference) < FARTHEST
    assert abs(ratio["log_bayes_factor"] - difference) < limit < np.log(2)
    draws = Store(ran()).read(f"posterior/swell/0/{LARGE}/nuts")
    mu_c = draws.arrays["draws"][..., list(draws.meta["posterior"]["names"]).index("mu_c")].ravel() / 0.005
    blind = float(gaussian_kde(mu_c).logpdf(0.0)[0]) - 0.5 * np.log(2 / np.pi)
    assert abs(blind - difference) > limit


def test_halves_of_the_record_make_its_evidence() -> None:
    """The density of the second half is the whole's evidence less the first half's; its error is within two of what
    the prediction expects. Control: the other model's halves do not make this one's."""
    for model, other in ((SMALL, LARGE), (LARGE, SMALL)):
        half, whole = of(model, "half").meta, weighed(model, "importance")["log_evidence"]
        assert half["evidence"]["outcome"] == "ok"
        made = half["log_predictive"] + half["evidence"]["log_evidence"]
        assert made == pytest.approx(whole, abs=1e-6)
        assert abs(made - weighed(other, "importance")["log_evidence"]) > 0.1
        assert half["start"] == pytest.approx(10.0, abs=0.1)
        assert half["rms"] < 2 * half["expected"]
