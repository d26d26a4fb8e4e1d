"""bayesdamp: how large is the damping of a decaying oscillation, which is it, and how sure may one be?

The public interface, each name loaded when it is first used:

- `load_study(path)`, `run_study(study, out)`: a study file, and its run (`bayesdamp study`).
- `read_record(path)`, `clean(raw, name=...)`: a measured record, and the free decay in it as a `Signal`.
- `Oscillator(damping, restoring)`, `simulate(oscillator, parameters, times)`: a trajectory.
- `features(signal)`: period, amplitude and roughness of a record.
"""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

# Before any array is made: double precision everywhere. JAX takes a second to load, and reads this when it does.
os.environ["JAX_ENABLE_X64"] = "1"
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)

__version__ = "0.1.0"

_HOME = {
    "load_study": "bayesdamp.config",
    "run_study": "bayesdamp.study",
    "read_record": "bayesdamp.signals.read",
    "clean": "bayesdamp.signals.clean",
    "features": "bayesdamp.signals.features",
    "Signal": "bayesdamp.types",
    "Oscillator": "bayesdamp.physics.oscillator",
    "simulate": "bayesdamp.physics.integrate",
}

__all__ = [
    "Oscillator",
    "Signal",
    "__version__",
    "clean",
    "features",
    "load_study",
    "read_record",
    "run_study",
    "simulate",
]


if TYPE_CHECKING:
    from bayesdamp.config import load_study
    from bayesdamp.physics.integrate import simulate
    from bayesdamp.physics.oscillator import Oscillator
    from bayesdamp.signals.clean import clean
    from bayesdamp.signals.features import features
    from bayesdamp.signals.read import read_record
    from bayesdamp.study import run_study
    from bayesdamp.types import Signal


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
