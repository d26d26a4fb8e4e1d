"""Simulate records with the faults of measured ones: noise, spikes, gaps and rounding."""

from collections.abc import Mapping

import numpy as np

from bayesdamp.physics.oscillator import Oscillator, simulate
from bayesdamp.types import InputError, Provenance, Signal

NOISES = ("gaussian", "correlated", "student_t")
"""Names of the noise models that can be simulated."""
GAP = 0.02
"""Length of one gap (missing samples) in a simulated record, as a fraction of the record (conventional)."""


def simulate_signal(
    osc: Oscillator,
    p: Mapping[str, float],
    *,
    duration: float,
    samples: int,
    noise_sd: float = 0.0,
    noise: str = "gaussian",
    noise_time: float | None = None,
    noise_dof: float | None = None,
    outliers: float = 0,
    gaps: int = 0,
    quantum: float = 0.0,
    quantity: str = "angle",
    unit: str = "rad",
    name: str = "simulated",
    rng: np.random.Generator,
) -> Signal:
    """Simulate a record of an oscillator at equally spaced times from 0 to `duration`, including both.

    Parameters
    ----------
    osc, p
        The oscillator, and the values of all its parameters by name (`Oscillator.parameters`), in rad or m (see `unit`)
        and s. These include the initial displacement `theta0` and the initial velocity `omega0`.
    duration
        Duration in s.
    samples
        Number of samples, before gaps are removed.
    noise_sd
        Standard deviation of the noise in the unit of the recorded quantity; for "student_t" its scale parameter.
    noise
        "gaussian" (white), "correlated", with a correlation of exp(−Δt/noise_time), or "student_t".
    noise_time
        Correlation time in s of "correlated" noise, which is white without it; no effect on other noise.
    noise_dof
        Degrees of freedom for "student_t", 1 by default; no effect on other noise.
    outliers
        Number of spikes or, if it is below 1, the fraction of samples that are spikes. The height of a spike is 0.3 to
        1 times half of the range of the motion, up or down.
    gaps
        Number of gaps. Each consists of 1/50 of the samples (at least one), which are removed; the first and the last
        sample remain.
    quantum
        Recording step to which the values are rounded, in the unit of the recorded quantity; 0 for none.
    quantity
        The recorded quantity: "angle" (the displacement), "velocity" or "acceleration".
    unit
        Unit of the displacement, "rad" or "m", in which `p` is given too. Nothing is converted.
    name
        Name of the record.
    rng
        Random generator for noise, spikes and gaps, in this order.

    Returns
    -------
    Signal
        The record. It does not contain the true parameters.

    Raises
    ------
    InputError
        If the noise is unknown, the gaps do not fit or take more than half of the record, or the motion diverges.
    ValueError
        If a parameter is missing or the quantity is unknown.
    Refusal
        If the restoring law or a damping term has no `kernel`.
    """
    length = max(int(GAP * samples), 1)
    if noise not in NOISES:
        raise InputError(f"unknown noise {noise!r}; valid are {', '.join(NOISES)}", name)
    free = samples - gaps * (length + 1) - 2
    if gaps * length > samples / 2 or free < 0:
        many = f"{gaps} gaps of {length} sample{'s' if length > 1 else ''} do not fit in {samples} samples"
        raise InputError(f"{many}, or take more than half of them; give fewer", name)
    t = np.linspace(0.0, duration, samples)
    clean = np.asarray(simulate(osc, dict(p), t, quantity=quantity), float)
    if not np.all(np.isfinite(clean)):
        raise InputError("the simulated oscillator does not stay finite; change its parameters", name)
    heavy = noise == "student_t"
    scatter = rng.standard_t(noise_dof or 1.0, samples) if heavy else rng.standard_normal(samples)
    if noise == "correlated" and noise_time is not None:
        rho = np.exp(-np.diff(t) / noise_time)
        for i in range(1, samples):
            scatter[i] = rho[i - 1] * scatter[i - 1] + np.sqrt(1 - rho[i - 1] ** 2) * scatter[i]
    y = clean + noise_sd * scatter
    notes = [f"Simulated: {samples} samples in {duration:g} s."]
    spikes = round(outliers * samples) if outliers < 1 else int(outliers)
    if spikes:
        at = rng.choice(samples, spikes, replace=False)
        y[at] += rng.choice([-1.0, 1.0], spikes) * rng.uniform(0.3, 1.0, spikes) * (np.ptp(clean) / 2)
    if quantum:
        y = np.round(y / quantum) * quantum
        notes.append(f"The values are rounded to steps of {quantum:.4g}.")
    keep = np.ones(samples, bool)
    if gaps:  # at random positions, with at least one sample between two gaps
        starts = np.sort(rng.integers(0, free + 1, gaps)) + 1 + np.arange(gaps) * (length + 1)
        keep[(starts[:, None] + np.arange(length)).ravel()] = False
        notes.append(f"{int((~keep).sum())} samples are missing.")
    provenance = Provenance(notes=tuple(notes), stop=float(t[keep][-1]))
    return Signal(t[keep], y[keep], quantity, unit, name, float(quantum), provenance)
