"""Simulate a record from damping terms, a restoring law, and values of their parameters."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bayesdamp import types
from bayesdamp.config import Simulation
from bayesdamp.config.checks import StudyError
from bayesdamp.config.signals import resolve_signal, term_keys
from bayesdamp.interface.signal import Signal
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.records.simulate import simulate_signal

START = {"theta0": 0.3, "omega0": 0.0, "epsilon": 0.0}
"""Default values of simulated records: displacement and velocity at the start (rad and rad/s, or m and m/s), and the
velocity within which Coulomb friction changes its sign (0: the sign function)."""
AT_REST = {"rest_angle": 0.0, "spring_angle": 0.0}
"""Default values of the two angles that shift the equilibrium of the oscillator. With these values the equilibrium is
at 0, unless gravity shifts it."""


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
    """Simulate a record of an oscillator with noise.

    The signal does not contain the true parameters. Use `trajectory` for a motion without noise.

    Parameters
    ----------
    damping
        Coefficient of each damping term, in `unit` and s, such as {"viscous": 0.05, "coulomb": 0.03}.
    restoring
        Name of the restoring law, such as "linear" or "pendulum".
    duration
        Length of the record in s.
    samples
        Number of equally spaced samples from 0 to `duration`, before gaps are removed.
    noise_sd
        Standard deviation of the noise, in the unit of the quantity (for "student_t" the scale); by default no noise.
    noise
        The noise model: "gaussian" (white), "correlated" or "student_t".
    outliers
        Number of outliers; a number below 1 is their fraction of the samples. Each shifts a sample by 0.3 to 1 times
        half of the range of the motion.
    gaps
        Number of gaps; each removes 1/50 of all samples.
    quantum
        Step to which values are rounded, in the unit of the quantity; 0 for no rounding.
    quantity
        "angle" (any displacement), "velocity" or "acceleration".
    unit
        Unit of the displacement, "rad" or "m"; a velocity is in this unit per s, an acceleration per s².
    seed
        Seed of all random numbers.
    name
        Name of the signal.
    **parameters
        Parameters of the restoring law (stiffness=20.0) and of damping terms (exponent=1.5), by name, in `unit` and s.
        Further parameters: theta0 and omega0, displacement and velocity at the start (by default 0.3 and 0.0); epsilon,
        the velocity within which Coulomb friction tanh(velocity/epsilon) changes its sign (by default 0, the sign
        function); noise_time (correlation time in s) for noise="correlated"; noise_dof (degrees of freedom, by default
        1) for "student_t". rest_angle and spring_angle are 0 by default.

    Returns
    -------
    Signal
        The record, in the unit `unit`.

    Raises
    ------
    InputError
        If an argument is invalid or missing, the motion grows without bound, or gaps take over half of the record.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, "pendulum", stiffness=20.0, duration=6.0, samples=150)
    >>> signal.t[-1].item(), round(signal.y[0].item(), 3)
    (6.0, 0.3)
    """
    needed = LAWS.get(restoring, "simulate").parameters
    terms = [TERMS.get(term, "simulate") for term in damping]
    further = (n for t in terms for n in t.further if n != "rest")
    numbers = (*needed, *START, "noise_time", "noise_dof", *further)
    for key in parameters:
        if key not in numbers:
            what = f"{restoring} has no parameter {key!r}"
            raise types.InputError(f"simulate: {what}{nearest(key, list(numbers))}")
    given = {**START, **{n: v for n, v in AT_REST.items() if n in needed}, **parameters}
    own = {p.name: term.name for term in terms for p in term.inferred}
    for parameter, what in {**dict.fromkeys(needed, restoring), **own}.items():
        if parameter not in given:
            raise types.InputError(f"simulate: {what} also needs {parameter}; give {parameter}=NUMBER")
    keys = {term: key for key, term in term_keys(needed).items()}
    options = {
        **{keys[term]: value for term, value in damping.items()}, **given,
        "duration": float(duration), "samples": samples, "noise_sd": float(noise_sd), "noise": noise,
        "outliers": float(outliers), "gaps": gaps, "quantum": float(quantum), "quantity": quantity, "unit": unit,
    }  # fmt: skip
    entry = {"name": "simulated", "simulate": options, "system": {"restoring": restoring}}
    try:  # check the options as those of a simulation in a study file
        source = resolve_signal(entry, {}, Path(), "").source
    except StudyError as error:
        key = error.where.removeprefix("simulate").removeprefix(".")
        raise types.InputError(f"{key}: {error.what}" if key else error.what, name) from None
    assert isinstance(source, Simulation)
    return Signal.of(simulate_source(source, restoring, source.truth, name, np.random.default_rng(seed)))


def simulate_source(
    source: Simulation, restoring: str, truth: Mapping[str, float], name: str, rng: np.random.Generator
) -> types.Signal:
    """Simulate a record from the settings in a study file.

    Parameters
    ----------
    source
        The settings: damping terms, duration, samples, noise model and so on.
    restoring
        The restoring law.
    truth
        True values of the parameters, by name, in the base unit (rad or m) and s; also noise_sd.
    name
        Name of the signal.
    rng
        Generator of all random numbers.

    Raises
    ------
    InputError
        If the motion grows without bound, or the gaps take more than half of the record.
    """
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
