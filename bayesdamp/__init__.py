"""bayesdamp: how large is the damping of a decaying oscillation, which is it, and how sure may one be?

The public interface, each name loaded when it is first used (docs/python.md shows it at work):

- records: `read(path)`, a `Record`, whose `signal()` is the free decay in it; `signal(t, y)` from arrays;
`simulate(...)`.
- one model on one record: `Model(...)` with priors (`HalfNormal`, `LogNormal`, `LogUniform`, `Normal`,
`Uniform`); `estimate(signal, name, model)`, `fit(signal, model)`, `sample(fit)`, `evidence(posterior)`,
`model.bind(signal)`.
- `read_envelope(path)`: where only the amplitude was recorded.
- studies: `load_study(path)`, `run_study(study)`.
- `load(path)`: whatever a result's `save` wrote. `InputError`, `Refusal`: what they raise.
- underneath: `read_record`, `clean`, `features`, `Oscillator`, `trajectory(oscillator, parameters, times)`.
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
    "Record": "bayesdamp.interface.records.record",
    "read": "bayesdamp.interface.records.record",
    "Signal": "bayesdamp.interface.records.signal",
    "signal": "bayesdamp.interface.records.signal",
    "simulate": "bayesdamp.interface.records.simulate",
    "Model": "bayesdamp.interface.model",
    "HalfNormal": "bayesdamp.priors",
    "LogNormal": "bayesdamp.priors",
    "LogUniform": "bayesdamp.priors",
    "Normal": "bayesdamp.priors",
    "Uniform": "bayesdamp.priors",
    "Estimate": "bayesdamp.interface.estimate",
    "estimate": "bayesdamp.interface.estimate",
    "Fit": "bayesdamp.interface.fit",
    "Prediction": "bayesdamp.interface.prediction",
    "EnvelopeRecord": "bayesdamp.records.envelope.record",
    "read_envelope": "bayesdamp.records.envelope.reading",
    "first_words": "bayesdamp.records.oscillation.first_look",
    "fit": "bayesdamp.interface.fit",
    "Density": "bayesdamp.interface.density",
    "Posterior": "bayesdamp.interface.posterior",
    "sample": "bayesdamp.interface.sampling",
    "Evidence": "bayesdamp.interface.evidence",
    "evidence": "bayesdamp.interface.evidence",
    "Comparison": "bayesdamp.interface.comparison",
    "Verdict": "bayesdamp.verdict.types",
    "compare": "bayesdamp.interface.comparison",
    "Candidate": "bayesdamp.interface.run",
    "Run": "bayesdamp.interface.run",
    "run_study": "bayesdamp.interface.run",
    "load": "bayesdamp.interface.load",
    "InputError": "bayesdamp.types",
    "Refusal": "bayesdamp.types",
    "Study": "bayesdamp.config",
    "load_study": "bayesdamp.config",
    "DampingTerm": "bayesdamp.physics.damping",
    "Oscillator": "bayesdamp.physics.oscillator",
    "clean": "bayesdamp.records.cleaning.clean",
    "features": "bayesdamp.records.oscillation.features",
    "read_record": "bayesdamp.records.read",
    "trajectory": "bayesdamp.physics.trajectories",
}
_THERE = {"trajectory": "simulate"}
"""What a name is called where it comes from, if something else."""

__all__ = [
    "Candidate",
    "Comparison",
    "DampingTerm",
    "Density",
    "EnvelopeRecord",
    "Estimate",
    "Evidence",
    "Fit",
    "HalfNormal",
    "InputError",
    "LogNormal",
    "LogUniform",
    "Model",
    "Normal",
    "Oscillator",
    "Posterior",
    "Prediction",
    "Record",
    "Refusal",
    "Run",
    "Signal",
    "Study",
    "Uniform",
    "Verdict",
    "__version__",
    "clean",
    "compare",
    "estimate",
    "evidence",
    "features",
    "first_words",
    "fit",
    "load",
    "load_study",
    "read",
    "read_envelope",
    "read_record",
    "run_study",
    "sample",
    "signal",
    "simulate",
    "trajectory",
]


if TYPE_CHECKING:
    from bayesdamp.config import Study, load_study
    from bayesdamp.interface.comparison import Comparison, compare
    from bayesdamp.interface.density import Density
    from bayesdamp.interface.estimate import Estimate, estimate
    from bayesdamp.interface.evidence import Evidence, evidence
    from bayesdamp.interface.fit import Fit, fit
    from bayesdamp.interface.load import load
    from bayesdamp.interface.model import Model
    from bayesdamp.interface.posterior import Posterior
    from bayesdamp.interface.prediction import Prediction
    from bayesdamp.interface.records.record import Record, read
    from bayesdamp.interface.records.signal import Signal, signal
    from bayesdamp.interface.records.simulate import simulate
    from bayesdamp.interface.run import Candidate, Run, run_study
    from bayesdamp.interface.sampling import sample
    from bayesdamp.physics.damping import DampingTerm
    from bayesdamp.physics.oscillator import Oscillator
    from bayesdamp.physics.trajectories import simulate as trajectory
    from bayesdamp.priors import HalfNormal, LogNormal, LogUniform, Normal, Uniform
    from bayesdamp.records.cleaning.clean import clean
    from bayesdamp.records.envelope.reading import read_envelope
    from bayesdamp.records.envelope.record import EnvelopeRecord
    from bayesdamp.records.oscillation.features import features
    from bayesdamp.records.oscillation.first_look import first_words
    from bayesdamp.records.read import read_record
    from bayesdamp.types import InputError, Refusal
    from bayesdamp.verdict.types import Verdict


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found = getattr(import_module(_HOME[name]), _THERE.get(name, name))
    if callable(found) and not isinstance(found, type):
        from bayesdamp.calls import told

        found = told(found, name)
        found.__module__, found.__qualname__ = __name__, name  # where other processes find it
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted(__all__)
