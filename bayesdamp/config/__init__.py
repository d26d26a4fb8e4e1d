"""A study file (TOML, version 1) as a frozen `Study`; every fault in it is one line."""

from bayesdamp.config.load import Study, load_study
from bayesdamp.config.signals import Recording, SignalSpec, Simulation

__all__ = ["Recording", "SignalSpec", "Simulation", "Study", "load_study"]
