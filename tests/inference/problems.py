"""Shared problems: records with references, their targets and modes, computed once in a process."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Posterior, Seed, Signal

REFERENCES = Path(__file__).resolve().parents[1] / "reference"
NAMES = ("viscous_coulomb", "coulomb_correlated", "touching_zero")

FEATURES = Features(
    rest=0.05,
    amplitude=0.3,
    final_amplitude=0.1,
    frequency=4.47,
    period=1.405,
    cycles=7.0,
    samples_per_cycle=40.0,
    roughness=0.01,
    turning_times=np.empty(0),
    turning_values=np.empty(0),
    turning_amplitudes=np.empty(0),
    crossing_times=np.empty(0),
)
"""Features of no record in particular, for default priors."""


@lru_cache
def reference(name: str) -> dict:
    """A reference posterior with its record, problem and provenance."""
    return json.loads((REFERENCES / f"{name}.json").read_text())


@lru_cache
def target(name: str) -> Target:
    """The target of a reference problem."""
    built = reference(name)
    problem = built["problem"]
    priors = {n: TypeAdapter(Prior).validate_python(p) for n, p in problem["priors"].items()}
    signal = Signal(np.array(built["record"]["t"]), np.array(built["record"]["y"]), name=name)
    osc = Oscillator(tuple(problem["damping"]), problem["restoring"])
    return Target(signal, osc, problem["noise"], priors, problem["known"])


@lru_cache
def mode(name: str) -> Mode:
    """Its mode, from the truth with every number moved by a tenth."""
    built = reference(name)
    seed = {n: 1.1 * v for n, v in built["truth"].items()}
    return find_mode(target(name), {Seed("near the truth"): seed}, noise_level=built["truth"]["noise_sd"])


SETTINGS = Settings(chains=4, warmup=500, draws=2500, seed=4)


@lru_cache
def posterior(name: str, sampler: str) -> Posterior:
    """Draws of a reference problem."""
    return SAMPLERS.get(sampler).sample(target(name), mode(name), SETTINGS)
