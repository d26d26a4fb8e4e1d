"""Effective samples of NUTS in the time of one gradient of the log posterior."""

from functools import partial

import numpy as np

from bayesdamp.inference.diagnostics import ess_bulk
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.samplers import SAMPLERS, Settings
from tests.benchmarks.page import add_table
from tests.benchmarks.timing import in_turns
from tests.inference import problems

NAME = "viscous_coulomb"
"""Reference problem, whose posterior the tests of the samplers check."""


def test_effective_samples_in_the_time_of_a_gradient() -> None:
    target, mode = problems.target(NAME), problems.mode(NAME)
    sample = partial(SAMPLERS.get("nuts").sample, target, mode, Settings(warmup=500, draws=500, seed=1))
    gradient = partial(Likelihood.near(target, mode.z, 1e-6).gradient, mode.z)
    nuts, one = in_turns(sample, gradient, rounds=1)
    size = min(map(ess_bulk, np.moveaxis(sample().draws, -1, 0)))
    rows = [[f"{size:.0f}", f"{nuts:.2f}", f"{1e6 * one:.0f}"]]
    header = ["effective samples", "CPU s", "gradient, µs"]
    add_table(
        "NUTS", header, rows, {"effective samples of NUTS in the time of a gradient": size * one / nuts}
    )
