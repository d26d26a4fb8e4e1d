"""Problems with reference posteriors, computed once in a process, and targets with a linear spring."""

import json
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter

from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, LogUniform, Normal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Posterior, Signal

REFERENCES = Path(__file__).resolve().parents[1] / "reference"
"""Folder of the reference posteriors. They come from emcee on trajectories of SciPy, without the package: their files
contain seed, method and versions. The script `tests/reference/make_reference.py` made coulomb_correlated.json at
revision e785313b and the other two at 36d9dc5d; its last revision is c123bb62."""
NAMES = ("viscous_coulomb", "coulomb_correlated", "touching_zero")

FEATURES = Features(
    rest=0.05, amplitude=0.3, final_amplitude=0.1, frequency=4.47, period=1.405, cycles=7.0,
    samples_per_cycle=40.0, roughness=0.01, turning_times=np.empty(0), turning_values=np.empty(0),
    turning_amplitudes=np.empty(0),
)  # fmt: skip
"""Features for default priors."""


PRIORS: dict[str, Prior] = {
    "zeta": HalfNormal(scale=0.8), "mu_c": HalfNormal(scale=1.0), "mu_q": HalfNormal(scale=3.0),
    "stiffness": LogNormal(median=20.0, sigma=0.5), "theta0": Normal(mean=0.0, sd=0.6),
    "omega0": Normal(mean=0.0, sd=2.7),
    "noise_sd": LogNormal(median=0.004, sigma=1.0), "noise_dof": LogNormal(median=6.0, sigma=0.8),
    "noise_time": LogUniform(low=7e-4, high=2.8),
}  # fmt: skip
"""Priors that are wide for amplitudes of a few tenths of a rad and 20 rad²/s²."""


def linear_target(
    t: np.ndarray,
    y: np.ndarray,
    damping: str,
    known: dict[str, float],
    noise: str = "gaussian",
    law: str = "linear",
    **priors: Prior,
) -> Target:
    """Return the target of an oscillator with one damping term, whose rest angle is 0.

    Parameters that are not known have wide priors, or the given ones."""
    parameters = TERMS.get(damping).parameter, "stiffness", "theta0", "omega0", *NOISES.get(noise).parameters
    chosen = {name: {**PRIORS, **priors}[name] for name in parameters if name not in known}
    known = {"rest_angle": 0.0, **known}
    return Target(Signal(t, y), Oscillator((damping,), law), noise, chosen, known)


@lru_cache
def reference(name: str) -> dict:
    """Return a reference posterior with its record, problem and provenance."""
    return json.loads((REFERENCES / f"{name}.json").read_text())


@lru_cache
def target(name: str) -> Target:
    """Return the target of a reference problem."""
    content = reference(name)
    problem = content["problem"]
    priors = {n: TypeAdapter(Prior).validate_python(p) for n, p in problem["priors"].items()}
    signal = Signal(np.array(content["record"]["t"]), np.array(content["record"]["y"]), name=name)
    osc = Oscillator(tuple(problem["damping"]), problem["restoring"])
    return Target(signal, osc, problem["noise"], priors, problem["known"])


@lru_cache
def mode(name: str) -> Mode:
    """Return the mode of a reference problem, by a search from parameters a tenth above the true ones."""
    content = reference(name)
    seed = {n: 1.1 * v for n, v in content["truth"].items()}
    return find_mode(target(name), [seed], noise_level=content["truth"]["noise_sd"])


SETTINGS = Settings(chains=4, warmup=500, draws=2500, seed=4)


@lru_cache
def posterior(name: str, sampler: str) -> Posterior:
    """Return draws of a sampler for a reference problem."""
    return SAMPLERS.get(sampler).sample(target(name), mode(name), SETTINGS)
