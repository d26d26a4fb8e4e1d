"""Samplers of a posterior: one class in one module each, looked up by name."""

from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.plugins import Registry

SAMPLERS: Registry[Sampler] = Registry("bayesdamp.inference.samplers", "sampler")

__all__ = ["SAMPLERS", "Sampler", "Settings"]
