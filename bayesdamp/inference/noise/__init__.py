"""Noise models: one class in one module each, found by name."""

from bayesdamp.inference.noise._noise import IndependentNoise, NoiseModel
from bayesdamp.plugins import Registry

NOISES: Registry[NoiseModel] = Registry("bayesdamp.inference.noise", "noise model")

__all__ = ["NOISES", "IndependentNoise", "NoiseModel"]
