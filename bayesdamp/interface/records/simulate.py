"""A simulated record, from the damping and the restoring law in words and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bayesdamp import types
from bayesdamp.config import Simulation
from bayesdamp.config.checks import StudyError
from bayesdamp.config.signals import resolve_signal, term_keys
from bayesdamp.interface.records.signal import Signal
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import InputError

START = {"theta0": 0.3, "omega0": 0.0, "epsilon": 0.0}
AT_REST = {"rest_angle": 0.0, "spring_angle": 0.0}
"""Where the oscillator rests where nobody says."""


def simulate(
    damping: Mapping[str, float],
    restoring: str = "linear",
    *,
    duration: float,
    samples: int,
    noise_sd: float = 0.0,
    noise: str = "gaussian",
    outliers: float = 0.0,
    gaps: int = 0,
    quantum: float = 0.0,
    quantity: str = "angle",
    unit: str = "rad",
    seed: int = 0,
    name: str = "simulated",
    **parameters: float,
) -> Signal:
    """A record of an oscillator with noise, as a signal.

    damping: coefficient by damping term, such as {"viscous": 0.05, "coulomb": 0.03}; what a term has beside it is given
    by name (exponent=1.5). restoring: the restoring law;
    parameters: its parameters by name (stiffness=20.0), theta0 (0.3), omega0 (0.0), the friction's epsilon (0.0: the
    sign itself), noise_time (s) for noise = "correlated", noise_dof for "student_t"; rest_angle and spring_angle are 0
    where they are not given. samples: equally spaced from 0 to duration (s). noise_sd, quantum (the recording step): in
    the unit of the quantity. outliers: how many, or their share below 1; gaps: stretches without samples. seed: of all
    random numbers. The signal holds nothing of the truth. For a trajectory alone see `trajectory`.
    Raises InputError, one line.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, "pendulum", stiffness=20.0, duration=6.0, samples=150)
    >>> signal.t[-1].item(), round(signal.y[0].item(), 3)
    (6.0, 0.3)
    """
    if restoring not in LAWS.names():
        raise InputError(f"simulate: unknown restoring law {restoring!r}{nearest(restoring, LAWS.names())}")
    for term in damping:
        if term not in TERMS.names():
            raise InputError(f"simulate: unknown damping term {term!r}{nearest(term, TERMS.names())}")
    needed = LAWS.get(restoring).parameters
    keys = {term: name for name, term in term_keys(needed).items()}
    damping = {keys[term]: value for term, value in damping.items()}
    further = [n for term in keys if keys[term] in damping for n in TERMS.get(term).further if n != "rest"]
    numbers = (*needed, *START, "noise_time", "noise_dof", *further)
    for key in parameters:
        if key not in numbers:
            raise InputError(f"simulate: {restoring} has no parameter {key!r}{nearest(key, list(numbers))}")
    given = {**START, **{n: v for n, v in AT_REST.items() if n in needed}, **parameters}
    beside = {p.name: term for term in keys if keys[term] in damping for p in TERMS.get(term).inferred}
    for parameter, what in {**dict.fromkeys(needed, restoring), **beside}.items():
        if parameter not in given:
            raise InputError(f"simulate: {what} needs {parameter} too; give {parameter}=NUMBER")
    options = {"duration": float(duration), "samples": samples, "noise_sd": float(noise_sd), "noise": noise}
    options |= {"outliers": float(outliers), "gaps": gaps, "quantum": float(quantum)}
    options |= {"quantity": quantity, "unit": unit}
    made = _checked({**damping, **given, **options}, restoring, name)
    return Signal.of(simulated(made, restoring, made.truth, name, np.random.default_rng(seed)))


def _checked(given: Mapping[str, object], restoring: str, name: str) -> Simulation:
    """The simulation as a study's own would be checked. Raises InputError in the terms of the arguments."""
    entry = {"name": "simulated", "simulate": dict(given), "system": {"restoring": restoring}}
    try:
        made = resolve_signal(entry, {}, Path(), "").source
    except StudyError as error:
        raise InputError(error.within("simulate"), name) from None
    assert isinstance(made, Simulation)
    return made


def simulated(
    source: Simulation, restoring: str, truth: Mapping[str, float], name: str, rng: np.random.Generator
) -> types.Signal:
    """Make a record as a study describes it. truth: the parameters' values. Raises InputError where it escapes."""
    return simulate_signal(
        Oscillator(source.damping, restoring),
        truth,
        **source.model_dump(exclude={"damping", "truth", "repeats"}),
        noise_sd=truth.get("noise_sd", 0.0),
        noise_time=truth.get("noise_time"),
        noise_dof=truth.get("noise_dof"),
        name=name,
        rng=rng,
    )
