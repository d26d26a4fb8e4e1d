"""bayesdamp: how large is the damping of a decaying oscillation, of which kind is it, and how certain is that?

This is the public interface. Each name is loaded at its first use; docs/python.md has examples:

- the answer: `compare(...)` compares damping models on a record; `first_words(signal)` measures frequency and damping
  without assuming a damping law.
- records: `read(path)` returns a `Record`, whose `signal()` is the free decay in it; `signal(t, y)` makes a signal from
  arrays; `simulate(...)` simulates a record.
- one model on one record: `Model(...)` with priors (`HalfNormal`, `LogNormal`, `LogUniform`, `Normal`, `Uniform`);
  `estimate(signal, name, model)`, `fit(signal, model)`, `sample(fit)`, `evidence(posterior)`, and `model.bind(signal)`,
  the model's posterior density on the signal.
- `read_envelope(path)`: reads a record that contains only the amplitude of an oscillation.
- studies: `load_study(path)` reads a study file, `run_study(study)` computes its results.
- `load(path)`: loads a result that `save` wrote. `InputError`, `Refusal`: the exceptions.
- lower level, for parts of an analysis: `read_record`, `clean`, `features`, `Oscillator`, `trajectory(oscillator,
  parameters, times)`; `DampingTerm` is the base class of your own damping terms.
"""

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING

# Use double precision in JAX. It reads this variable when it is imported, which takes a second and is not done here.
os.environ["JAX_ENABLE_X64"] = "1"
if "jax" in sys.modules:
    sys.modules["jax"].config.update("jax_enable_x64", True)

__version__ = "0.1.0"

_NAMES = {
    "config": ("Study", "load_study"),
    "interface.comparison": ("Comparison", "compare"),
    "interface.estimate": ("Estimate", "estimate"),
    "interface.first_words": ("first_words",),
    "interface.fit": ("Fit", "Prediction", "fit"),
    "interface.model": ("Density", "Model"),
    "interface.posterior": ("Evidence", "Posterior", "evidence", "sample"),
    "interface.result": ("load",),
    "interface.signal": ("Record", "Signal", "read", "signal"),
    "interface.simulate": ("simulate",),
    "physics.damping": ("DampingTerm",),
    "physics.oscillator": ("Oscillator", "trajectory"),
    "pipeline.results": ("Candidate", "Run", "run_study"),
    "priors": ("HalfNormal", "LogNormal", "LogUniform", "Normal", "Uniform"),
    "records.cleaning.clean": ("clean",),
    "records.envelope.record": ("EnvelopeRecord", "read_envelope"),
    "records.oscillation.features": ("features",),
    "records.read": ("read_record",),
    "types": ("InputError", "Refusal"),
    "verdict.types": ("Verdict",),
}
"""The public names that each module provides; the key is the module's path below `bayesdamp`."""
_HOME = {name: f"bayesdamp.{module}" for module, names in _NAMES.items() for name in names}
_NAME_THERE = {"trajectory": "simulate"}
"""Public names that are renamed here: for each, its name in the module that provides it."""
__all__ = ["__version__", "trajectory", *(_HOME.keys() - {"trajectory"})]  # pyright: ignore[reportUnsupportedDunderAll]

if TYPE_CHECKING:
    from bayesdamp.config import Study as Study, load_study as load_study
    from bayesdamp.interface.comparison import Comparison as Comparison, compare as compare
    from bayesdamp.interface.estimate import Estimate as Estimate, estimate as estimate
    from bayesdamp.interface.first_words import first_words as first_words
    from bayesdamp.interface.fit import Fit as Fit, Prediction as Prediction, fit as fit
    from bayesdamp.interface.model import Density as Density, Model as Model
    from bayesdamp.interface.posterior import (
        Evidence as Evidence,
        Posterior as Posterior,
        evidence as evidence,
        sample as sample,
    )
    from bayesdamp.interface.result import load as load
    from bayesdamp.interface.signal import Record as Record, Signal as Signal, read as read, signal as signal
    from bayesdamp.interface.simulate import simulate as simulate
    from bayesdamp.physics.damping import DampingTerm as DampingTerm
    from bayesdamp.physics.oscillator import Oscillator as Oscillator, simulate as trajectory
    from bayesdamp.pipeline.results import Candidate as Candidate, Run as Run, run_study as run_study
    from bayesdamp.priors import (
        HalfNormal as HalfNormal,
        LogNormal as LogNormal,
        LogUniform as LogUniform,
        Normal as Normal,
        Uniform as Uniform,
    )
    from bayesdamp.records.cleaning.clean import clean as clean
    from bayesdamp.records.envelope.record import (
        EnvelopeRecord as EnvelopeRecord,
        read_envelope as read_envelope,
    )
    from bayesdamp.records.oscillation.features import features as features
    from bayesdamp.records.read import read_record as read_record
    from bayesdamp.types import InputError as InputError, Refusal as Refusal
    from bayesdamp.verdict.types import Verdict as Verdict


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), _NAME_THERE.get(name, name))
    if callable(value) and not isinstance(value, type):
        from bayesdamp.calls import checked_call

        value = checked_call(value, name)
        value.__module__, value.__qualname__ = __name__, name  # so that pickle finds it
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
