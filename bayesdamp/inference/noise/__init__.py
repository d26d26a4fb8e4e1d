"""Noise models: one class in one module each, looked up by name."""

from bayesdamp.inference.noise._noise import (
    CORRELATED,
    GAUSSIAN,
    NOISES,
    FittedNoise,
    IndependentNoise,
    NoiseModel,
    SampleNoise,
    fit_noise,
)

__all__ = [
    "CORRELATED",
    "GAUSSIAN",
    "NOISES",
    "FittedNoise",
    "IndependentNoise",
    "NoiseModel",
    "SampleNoise",
    "fit_noise",
]
