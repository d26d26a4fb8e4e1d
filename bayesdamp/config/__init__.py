"""A study file (TOML, version 1) as a frozen `Study`; every fault in it is one line."""

from bayesdamp.config.load import load_study
from bayesdamp.config.study import Recording, SignalSpec, Simulation, Study

__all__ = ["Recording", "SignalSpec", "Simulation", "Study", "load_study"]
