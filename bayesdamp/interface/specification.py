"""Specify a model of one decay: damping, restoring law, noise, and what is known or believed of their parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from bayesdamp import types
from bayesdamp.config.checks import StudyError
from bayesdamp.config.sections import DEVIATIONS
from bayesdamp.config.signals import canonical_model
from bayesdamp.inference.deviation.findings import SENSOR
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.arguments import (
    POSITIVE,
    by_parameter,
    check_known,
    check_noise,
    check_priors,
    check_sensor,
    coefficients_of,
    number,
)
from bayesdamp.interface.result import Result
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.plugins import nearest
from bayesdamp.priors import Prior
from bayesdamp.table import Table
from bayesdamp.types import InputError, System

if TYPE_CHECKING:
    import pandas as pd

FIXED = (*POSITIVE, "epsilon")
"""Parameters that are not inferred where laws hold approximately: known, or determined from the record once."""


@dataclass(frozen=True, repr=False)
class Specification(Result):
    """A model of a record, as `bayesdamp.Model` explains it; that class can also be bound to a record."""

    damping: str
    restoring: str = "linear"
    noise: str | tuple[str, ...] = "auto"
    priors: Mapping[str, Prior] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    deviation: str = "none"
    sensor: float = SENSOR
    amplitude: float | None = None
    frequency: float | None = None

    def __post_init__(self) -> None:
        try:
            damping = canonical_model(self.damping, "damping")
        except StudyError as error:
            raise InputError(f"Model: {error}") from None
        for what, given, valid in (
            ("restoring law", self.restoring, LAWS.names()),
            ("deviation", self.deviation, list(DEVIATIONS)),
        ):
            if given not in valid:
                raise InputError(f"Model: unknown {what} {given!r}{nearest(str(given), valid)}")
        object.__setattr__(self, "damping", damping)
        object.__setattr__(self, "noise", self.noise if isinstance(self.noise, str) else tuple(self.noise))
        check_noise("Model", self.noise)
        if self.approximate:
            check_sensor("Model", self.sensor)
            for name in self.priors:
                if name in FIXED:
                    raise InputError(
                        f"Model: the prior of {name!r} has no meaning under deviation {self.deviation!r}, which fixes "
                        "it; remove it, or give it as known"
                    )
        known = check_known("Model", self.known, self._coefficients, self.parameters)
        priors = check_priors("Model", self.priors, known, self._coefficients, self.parameters)
        object.__setattr__(self, "known", {n: v for n, v in known.items() if n in self.parameters})
        object.__setattr__(self, "priors", priors)
        for name in ("amplitude", "frequency"):
            value = getattr(self, name)
            if value is not None and not number(value) > 0:
                raise InputError(f"Model: {name} is {value!r}; it must be a positive number")

    def __hash__(self) -> int:
        mappings = (
            tuple(sorted(self.known.items())),
            tuple(sorted(self.priors.items(), key=lambda item: item[0])),
        )
        return hash((self.damping, self.restoring, self.noise, self.deviation, self.sensor, *mappings))

    @property
    def name(self) -> str:
        """Damping and restoring law: `viscous+coulomb@pendulum`."""
        return types.candidate_name(self.damping, self.restoring)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the damping terms."""
        return tuple(self.damping.split("+"))

    @property
    def noises(self) -> tuple[str, ...]:
        """The noise models in play."""
        if self.noise == "auto":
            return tuple(NOISES.names())
        return (self.noise,) if isinstance(self.noise, str) else self.noise

    @property
    def approximate(self) -> bool:
        """Whether laws may hold approximately."""
        return self.deviation != "none"

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters, known ones included; of the noise, those of all models in play."""
        noise = dict.fromkeys(p for n in self.noises for p in NOISES.get(n).parameters)
        return (*Oscillator(self.terms, self.restoring).parameters, *noise)

    @property
    def system(self) -> System:
        """What is known and believed of all but the damping, as the other packages need it."""
        free: dict[str, object | None] = {n: None for n in self.parameters if n not in self._coefficients}
        given = {n: p for n, p in self.priors.items() if n in free}
        free = {n: given.get(n) for n in free if n not in self.known and (n != "epsilon" or n in given)}
        return System(self.restoring, dict(self.known), free, self.amplitude, self.frequency)

    @property
    def parameter_priors(self) -> dict[str, Prior]:
        """The priors that are given, by parameter."""
        return by_parameter(self.priors, self._coefficients)

    @property
    def term_priors(self) -> dict[str, Prior]:
        """The priors that are given for damping terms or coefficients, by term."""
        by_name = {**self._coefficients, **{t: t for t in self.terms}}
        return {by_name[n]: p for n, p in self.priors.items() if n in by_name}

    @property
    def _coefficients(self) -> dict[str, str]:
        """The term of each coefficient."""
        return coefficients_of(self.terms)

    def summary(self) -> pd.DataFrame:
        """Return a row for each parameter: its value where it is known, and the prior that was given.

        Default priors depend on the record and are in the summary of a fit.
        """
        import pandas as pd

        given = {n: p.describe() for n, p in self.parameter_priors.items()}
        rows = [(n, self.known.get(n), given.get(n)) for n in self.parameters]
        return pd.DataFrame(rows, columns=["parameter", "known", "prior"]).set_index("parameter")

    def _table(self) -> Table:
        rows = [("damping", self.damping), ("restoring", self.restoring)]
        rows += [("noise", self.noise if isinstance(self.noise, str) else " or ".join(self.noise))]
        rows += [("deviation", self.deviation), ("sensor", f"{self.sensor:.3g}")] * self.approximate
        rows += [(f"prior of {n}", p.describe()) for n, p in self.priors.items()]
        rows += [(n, f"{v:.6g} (known)") for n, v in self.known.items()]
        return Table(("", ""), rows, caption=f"Model {self.name}")


def units_of(names: Iterable[str], restoring: str, signal: types.Signal) -> dict[str, str]:
    """Return the unit of each parameter on a record."""
    return {n: parameter_unit(n, restoring, signal.unit, signal.quantity) for n in names}
