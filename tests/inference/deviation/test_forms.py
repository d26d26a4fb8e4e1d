"""The exponent of a power law, and a rival form, on records of SciPy's solver."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.findings import Findings, findings
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.types import Signal

W, A, SD = 4.5, 0.3, 0.001
TIMES = np.arange(900) * 2 * math.pi / W / 30


@lru_cache
def found(kind: str, exponent: float = 1.0) -> Findings:
    """A linear spring with c |v|^p, or with c x² v."""

    def force(x: float, v: float) -> float:
        if kind == "displacement":
            return 2.0 * x * x * v + 0.02 * v
        return 0.08 * A * W * abs(v / (A * W)) ** exponent * math.copysign(1.0, v)

    run = solve_ivp(
        lambda _, y: [y[1], -force(y[0], y[1]) - W**2 * y[0]], (0, TIMES[-1]), [A, 0.0], t_eval=TIMES,
        rtol=1e-9, atol=1e-11, max_step=0.05,
    )  # fmt: skip
    y = run.y[0] + SD * np.random.default_rng(3).standard_normal(TIMES.size)
    return findings(weighing_of(Signal(TIMES, y), restoring=["linear"]))


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0])
def test_the_exponent_is_found(exponent: float) -> None:
    """95 % intervals: of three seeds one in seven would fail were they not wider; the seed was not chosen."""
    q = found("power", exponent).exponent
    assert q is not None
    assert q.low - 0.01 < exponent < q.high + 0.01
    assert not q.low < exponent + 0.5 < q.high  # control
    assert q.high - q.low < 0.5


def test_a_form_that_is_none_of_the_sums_is_a_rival() -> None:
    said = found("displacement")
    assert sum(p for name, p in said.exotic.items() if "displacement" in name) > 0.5
    control = found("power", 1.0)
    assert sum(control.exotic.values()) < 0.2
    assert sum(control.damping.values()) + sum(control.exotic.values()) == pytest.approx(1.0)
