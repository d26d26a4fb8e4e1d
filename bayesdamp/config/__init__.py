"""Read a study file (TOML, version 1) into a frozen `Study`. Each error message is one line."""

from bayesdamp.config.checks import in_keys
from bayesdamp.config.load import load_study
from bayesdamp.config.study import Recording, SignalSpec, Simulation, Study

__all__ = ["Recording", "SignalSpec", "Simulation", "Study", "in_keys", "load_study"]
