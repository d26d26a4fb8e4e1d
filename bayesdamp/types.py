"""Define the data types that all parts of the package share (frozen dataclasses with hardly any methods), and units.

The outcome of a task is stored as text: `ok`, or a sentence. The sentence begins with the words of a `Status`, such as
"failed:"; without such words it is the reason why a method refused the record. Likewise the sentence on the fit of a
model begins with the words of a `FitStatus`. Only the functions below these two classes write and interpret the words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from enum import Enum
from typing import TYPE_CHECKING, Any, Self

from bayesdamp.serial import join

if TYPE_CHECKING:
    import numpy as np


OK = "ok"
"""Outcome of a task that succeeded. Any other outcome is a sentence that says what went wrong or why the result is
doubtful."""
VERDICT_SCHEMA = 3
"""Version of the format of verdict.json; it increases if a field is renamed, removed, or changes its meaning."""
NORMAL_95 = 1.959963984540054
"""Half the width of the central 95 % interval of a normal distribution, in standard deviations."""
SENSOR = 0.002
"""Default relative standard deviation of the systematic error of every damping ratio that the sensor causes, by its
nonlinearity and its clock. A record does not show this error (conventional)."""
DERIVATIVES = {"angle": 0, "velocity": 1, "acceleration": 2}
"""By the name of the recorded quantity: which time derivative of the displacement it is (0 for the displacement
itself)."""
LAW_MARK = "@"
"""Separator in the name of a candidate, such as `viscous+coulomb@pendulum`: between the damping sum and the restoring
law."""
_OPTIONS = {"value": "angle", "channels": "channel"}
"""Command line options whose name differs from that of the argument of `read`: the option's name, by argument."""


class BayesdampError(Exception):
    """Base class of errors that a user can correct; the message is one line."""


class InputError(BayesdampError):
    """An error in the input. The message says where it is, what is wrong, and what to do (exit status 2).

    what: the fault, and what to do. where: the file, record, option or argument; "" if it is not known. at: the
    position in it, such as a line; "" if there is none. arguments: names of arguments of `read` with which the user can
    resolve the error; the message names the corresponding command line options.
    """

    def __init__(self, what: str, where: str = "", at: str = "", arguments: Sequence[str] = ()) -> None:
        self.what, self.where, self.at, self.arguments = what, where, at, tuple(arguments)
        place = ", ".join(filter(None, (where, at)))
        options = ", ".join(f"--{_OPTIONS.get(a, a).replace('_', '-')}" for a in self.arguments)
        super().__init__((f"{place}: {what}" if place else what) + (f" ({options})" if options else ""))

    def naming(self, name: Callable[[str], str]) -> InputError:
        """Return this error with another notation of its `arguments` in the message.

        In the new message an argument is `name(argument)`, such as "unit=", instead of the command line option. The
        field `arguments` of the result is empty.
        """
        named = ", ".join(map(name, self.arguments))
        return InputError(f"{self.what} ({named})" if named else self.what, self.where, self.at)


class Refusal(BayesdampError):  # noqa: N818 - a method's answer, not an error
    """Raised if a method cannot be applied to a record. The message is a sentence with the reason, shown in tables."""


Fact = str | float
"""A value in the metadata of a record's file: a number or a text."""


@dataclass(frozen=True)
class FreeDecay:
    """A free decay in a record, from `start` to `stop` (s, on the time axis of the record)."""

    start: float
    stop: float


@dataclass(frozen=True)
class Provenance:
    """How a record was read, and what was done to it.

    warnings: sentences that the user must see. notes: sentences on what was done. header_lines: number of skipped
    lines. facts: metadata in the file, by name. time_column, value_column: labels of the columns in the file.
    time_unit: source of the unit of the times: "given" (the user), "file", or "" if none is stated. first_line: line
    number (from 1) of the first row of numbers; None if samples do not correspond to lines. unit: unit of the file's
    values, or of the displacement (mm for mm/s): a name in UNITS, not its base unit. start, stop: ends of the used part
    of the record, in s on its time axis; stop is None if the record was not cleaned. offset: constant that was
    subtracted from all values, in the base unit (as `Signal.y`). drift: slope of the line through zero at `start` that
    was subtracted too, in this unit per s. decays: all free decays in the record, including the used one.
    """

    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    header_lines: int = 0
    facts: Mapping[str, Fact] = field(default_factory=dict)
    time_column: str = ""
    value_column: str = ""
    time_unit: str = ""
    first_line: int | None = None
    unit: str = ""
    start: float = 0.0
    stop: float | None = None
    offset: float = 0.0
    drift: float = 0.0
    decays: tuple[FreeDecay, ...] = ()

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return the sentences for the user: warnings (after "Beware: "), number of header lines, notes."""
        head = self.header_lines
        lines = [f"Beware: {text}" for text in self.warnings]
        lines += [f"{head} header line{'s' if head != 1 else ''} skipped."] if head else []
        return (*lines, *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return the provenance as a dictionary for run.json; `of` is the inverse.

        Fields that are empty or None are left out, except `warnings` and `notes`.
        """
        values = asdict(self)
        always = {name: list(values.pop(name)) for name in ("warnings", "notes")}
        return {n: v for n, v in values.items() if v not in ((), {}, "", None)} | always

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Rebuild the provenance from a dictionary of `to_dict`.

        The dictionary may come from JSON and contain further keys, which are ignored.
        """
        own = {f.name for f in fields(cls)}
        return join(cls, {name: value for name, value in given.items() if name in own and value is not None})


@dataclass(frozen=True, eq=False)
class Signal:
    """A record after cleaning, in base units. Two instances are equal only if they are the same object.

    t: times in s, shape (n,), strictly increasing, t[0] = 0 at the first sample. y: the recorded quantity, shape (n,):
    in `unit`, for a velocity in `unit` per s, for an acceleration in `unit` per s². quantity: "angle", "velocity" or
    "acceleration". unit: unit of the displacement: "rad", "m", or that of a sensor of unknown scale, such as "V". name:
    name of the record. step: recording step (quantisation) in the unit of y; 0 if none is detected. provenance: how the
    record was read, and what was done to it.
    """

    t: np.ndarray
    y: np.ndarray
    quantity: str = "angle"
    unit: str = "rad"
    name: str = "signal"
    step: float = 0.0
    provenance: Provenance = field(default_factory=Provenance)

    @property
    def uniform(self) -> bool:
        """Return whether the samples are equally spaced, within 1/1000 of the mean spacing."""
        gaps = self.t[1:] - self.t[:-1]
        return bool((abs(gaps - gaps.mean()) <= 1e-3 * gaps.mean()).all())


@dataclass(frozen=True)
class FeatureValues:
    """Features of a decaying oscillation, as single numbers that can be stored.

    rest: equilibrium in the base unit of displacement, the median midline of the last half of the turning points; 0 for
    velocity and acceleration. amplitude, final_amplitude: displacement amplitude at the first and at the last sample,
    in the same unit. frequency, period: mean over the record, in rad/s and s, from a line through the times of its
    turning points. cycles: number of cycles, with fractions, whose turning points are distinguishable from the noise.
    samples_per_cycle: number of samples in a mean period. roughness: standard deviation of the noise, in the unit of
    the recorded quantity.
    """

    rest: float
    amplitude: float
    final_amplitude: float
    frequency: float
    period: float
    cycles: float
    samples_per_cycle: float
    roughness: float


@dataclass(frozen=True)
class Symbol:
    """The notation of a parameter or a derived quantity.

    text: symbol in sentences and tables. math: LaTeX symbol in figures. meaning: description in words.
    """

    text: str
    math: str
    meaning: str


@dataclass(frozen=True)
class System:
    """What is known about the oscillator before inference.

    restoring: name of the restoring law. known: specified values of parameters (of the restoring law, theta0, omega0,
    epsilon, noise_sd, ...), by name. free: priors of inferred parameters, by name; None for the default prior.
    Parameters in neither mapping are inferred with default priors, except epsilon, which is then fixed. amplitude,
    frequency: reference amplitude (unit of displacement) and frequency (rad/s), if specified.
    """

    restoring: str
    known: Mapping[str, float] = field(default_factory=dict)
    free: Mapping[str, object | None] = field(default_factory=dict)
    amplitude: float | None = None
    frequency: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A point estimate of the damping by one method, at one stage.

    estimator: name of the method. stage: "initial" for the method's own estimate, "refined" for the trajectory fit that
    starts there. values, stderr: values and standard errors of the parameters that are computed, by name (SI units).
    details: further results of the method (selected terms, an expression, a learnt force), as strings, numbers and
    lists of these. evaluations: number of simulations, fits or models that the method evaluated. seconds: computing
    time. outcome: `ok`, why the method failed (there are then no values), or why the values are doubtful.
    """

    estimator: str
    stage: str
    values: Mapping[str, float] = field(default_factory=dict)
    stderr: Mapping[str, float] = field(default_factory=dict)
    details: Mapping[str, object] = field(default_factory=dict)
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK


@dataclass(frozen=True)
class FitCheck:
    """The checks of how well a model fits a record, at the mode of its posterior; nan or "" if they were not made.

    Attributes
    ----------
    rms
        Rms of the residuals, in the base unit of the record (such as rad, or rad/s for a velocity).
    residual_autocorrelation
        Autocorrelation of the residuals at lag one.
    predictive_p
        Posterior predictive p-value of the autocorrelation of the whitened residuals.
    window_spread
        Largest difference of a damping coefficient between a half and the whole record, in standard deviations that
        such a difference has by chance.
    verdict
        Text that says whether the model fits, and if not, why; it begins with the words of a `FitStatus`.
    """

    rms: float = float("nan")
    residual_autocorrelation: float = float("nan")
    predictive_p: float = float("nan")
    window_spread: float = float("nan")
    verdict: str = ""


@dataclass(frozen=True)
class Ratio:
    """The posterior of the equivalent viscous damping ratio (a fraction) at one amplitude.

    amplitude: in rad or m. value: median. low, high: ends of the 95 % interval. sd_noise, sd_law: contributions to the
    standard deviation, by the noise and by deviations of the motion from the damping and restoring laws.
    """

    amplitude: float
    value: float
    low: float
    high: float
    sd_noise: float
    sd_law: float


@dataclass(frozen=True)
class LawFreeDamping:
    """Damping and frequency of a record at k amplitudes, measured without assuming a damping law or restoring law.

    Attributes
    ----------
    amplitude : ndarray, shape (k,)
        Amplitude of the displacement, in its base unit (rad, m, V, ...).
    ratio, ratio_sd : ndarray, shape (k,)
        Equivalent viscous damping ratio, and its standard error. The ratio is r/√(1 + r²), where r is the rate of
        energy loss divided by 2ω times the energy of the oscillation; for a linear spring, r is −(dA/dt)/(ωA). For
        light damping the ratio is the energy lost in a cycle, divided by 4π times the energy; for viscous damping it is
        exactly the usual damping ratio.
    frequency, frequency_sd : ndarray, shape (k,)
        Frequency in Hz, and its standard error.
    energy : ndarray, shape (k,)
        Energy of the oscillation per unit of inertia, in the square of the amplitude's unit per s².
    sentence : str
        Description of this result in words, if `first_words` made it; otherwise empty.
    """

    amplitude: np.ndarray
    ratio: np.ndarray
    ratio_sd: np.ndarray
    frequency: np.ndarray
    frequency_sd: np.ndarray
    energy: np.ndarray
    sentence: str = ""


FRICTION_WIDTH = 0.02
"""Default width ε of the velocity range around zero in which dry friction changes its sign, as a fraction of the peak
velocity (conventional)."""


@dataclass(frozen=True)
class Reference:
    """Reference amplitude (rad or m) and angular frequency (rad/s).

    The widths of default priors scale with these two.
    """

    amplitude: float
    frequency: float

    def scales(self, rest: float) -> dict[str, float]:
        """Return the numbers on which some damping forces depend besides parameters, by name.

        They are `rest` (the equilibrium in rad or m, an argument), `reference_velocity` (the peak velocity at the
        reference amplitude) and `reference_amplitude`.
        """
        return {"rest": rest, "reference_velocity": self.peak_velocity, "reference_amplitude": self.amplitude}

    @property
    def peak_velocity(self) -> float:
        """Return the peak velocity of a motion with the reference amplitude: amplitude · frequency (rad/s or m/s)."""
        return self.amplitude * self.frequency

    @property
    def friction_width(self) -> float:
        """Return the default ε (rad/s or m/s): the width of the velocity range in which dry friction changes sign."""
        return FRICTION_WIDTH * self.peak_velocity


@dataclass(frozen=True)
class Friction:
    """A trial value of ε, the width of the velocity range in which dry friction changes its sign, and the fit with it.

    epsilon: ε in rad/s or m/s. weight: posterior probability of this value among those that were tried. coefficients,
    further: coefficients of all damping terms, and the other parameters of these terms, in this fit.
    """

    epsilon: float
    weight: float
    coefficients: tuple[float, ...]
    further: tuple[float, ...] = ()


@dataclass(frozen=True)
class Posterior:
    """Draws from a posterior: draws[chain, draw, parameter], parameter values in their units (not transformed scores).

    sampler: name of the sampler. names: names of the parameters. log_likelihood: log likelihood of each draw in nats,
    (chain, draw). stats: statistics of the sampler by name, such as the acceptance rate. summaries: for each parameter,
    statistics of its draws by name. divergences: number of divergent transitions; None for samplers without them.
    evaluations: number of likelihood evaluations. ensembles: number of groups of chains, if the chains of a group
    depend on each other; None if all chains are independent. diagnostics: further diagnostics of the sampler. seconds:
    computing time. outcome: `ok`, or why the draws are unreliable or missing.
    """

    sampler: str
    names: tuple[str, ...]
    draws: np.ndarray
    log_likelihood: np.ndarray
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    diagnostics: Mapping[str, object] = field(default_factory=dict)
    seconds: float = 0.0
    outcome: str = OK
    summaries: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    divergences: int | None = None
    evaluations: int = 0
    ensembles: int | None = None


@dataclass(frozen=True)
class Evidence:
    """Log marginal likelihood (nats) of one model by one method, with its standard error and diagnostic.

    model: name of the candidate, such as `viscous@pendulum`. log_evidence and stderr are NaN if they could not be
    computed; stderr also for Laplace's approximation. diagnostic: text on the reliability of the result; "" if the
    method has none. evaluations: number of likelihood evaluations. seconds: computing time. outcome: `ok`, or why the
    result is unreliable or missing.
    """

    model: str
    method: str
    log_evidence: float = float("nan")
    stderr: float = float("nan")
    diagnostic: str = ""
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK


def candidate_name(damping: str, restoring: str = "") -> str:
    """Return the name of a candidate: `viscous+coulomb@pendulum`, or `viscous+coulomb` if it has no restoring law."""
    return f"{damping}{LAW_MARK}{restoring}" if restoring else damping


def candidate_parts(name: str) -> tuple[str, str]:
    """Return the damping sum and the restoring law in the name of a candidate, such as `viscous+coulomb@pendulum`.

    If the name contains no `@`, the law is "".
    """
    damping, _, restoring = name.partition(LAW_MARK)
    return damping, restoring


def sum_probabilities(probabilities: Mapping[str, float], part: int = 0) -> dict[str, float]:
    """Return the total probability of each damping sum over all restoring laws, or of each law over all sums.

    The result is sorted, the largest total first. probabilities: probabilities of candidates by name (sum of damping
    terms and restoring law). part: 0 for the totals of damping sums, 1 for those of restoring laws.
    """
    sums: dict[str, float] = {}
    for name, p in probabilities.items():
        key = candidate_parts(name)[part]
        sums[key] = sums.get(key, 0.0) + p
    return dict(sorted(sums.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class Problem:
    """The problem that an estimator solves: which damping coefficients to estimate, and what is known.

    damping: names of the damping terms whose coefficients are estimated. system: restoring law, known values and
    priors.
    """

    damping: tuple[str, ...]
    system: System


P_LIMIT = 0.01
"""A model counts as not fitting if its posterior predictive p-value is below this (conventional). A p-value near 1 is
not a misfit: the residuals are then less autocorrelated than most white noise, because the fit absorbs a part of the
noise."""


class _Beginning(Enum):
    """Base of enumerations whose values are the first words of a sentence."""

    def because(self, reason: str) -> str:
        """Return the sentence "VALUE: REASON", which begins with the words of this member, such as "pruned: ..."."""
        return f"{self.value}: {reason}"


class Status(_Beginning):
    """The outcome of a task; the value contains the first words of its sentence.

    FAILED: the task failed because of a fault of the program. NOT_COMPUTED: the task depends on another one, which
    failed. Both are computed again in the next run. PRUNED: the model is left out, because it is much less probable
    than the best one, or because its motion does not follow the record. NOT_SAMPLED: the posterior of the model, and
    results that need its draws, are left out, because the model is not among the best by evidence. NOT_APPLICABLE: the
    record has no posterior, because it has no noise. REFUSED: a method cannot work on this record; the sentence is the
    reason alone.
    """

    OK = "ok"
    FAILED = "failed"
    NOT_COMPUTED = "not computed"
    PRUNED = "pruned"
    NOT_SAMPLED = "not sampled"
    NOT_APPLICABLE = "not applicable"
    REFUSED = ""


class FitStatus(_Beginning):
    """Whether a model fits a record; the value contains the first words of the sentence on its fit."""

    FITS = "fits"
    DOES_NOT_FIT = "does not fit"


def status_of(outcome: str) -> Status:
    """Return the status of a task from the text of its outcome.

    It is the status whose words are the text, or stand before a colon at its beginning; `REFUSED` if there is none.
    """
    if outcome == Status.OK.value:
        return Status.OK
    named = (s for s in Status if s not in (Status.OK, Status.REFUSED))
    return next((s for s in named if outcome == s.value or outcome.startswith(f"{s.value}:")), Status.REFUSED)


def fitting_of(sentence: str) -> FitStatus | None:
    """Return whether a model fits, from the first words of the sentence on its fit.

    The result is None if the sentence does not begin with a value of `FitStatus`, as when nothing was checked.
    """
    return next((fitting for fitting in FitStatus if sentence.startswith(fitting.value)), None)


def reason_of(sentence: str) -> str:
    """Return a sentence without its first words if these are a value of `Status` or `FitStatus`, such as "failed:".

    A sentence that does not begin with such words is returned unchanged.
    """
    for beginning in (*Status, *FitStatus):
        if beginning.value and sentence.startswith(f"{beginning.value}:"):
            return sentence.removeprefix(f"{beginning.value}:").lstrip()
    return sentence


def following(name: str, outcome: str) -> str:
    """Return the outcome of a task that cannot be computed because another task, on which it depends, is not ok.

    name, outcome: name and outcome of that other task. If it failed, the result is "not computed: ...", which names it;
    otherwise the result is the outcome of the other task.
    """
    if status_of(outcome) is Status.FAILED:
        return Status.NOT_COMPUTED.because(f"{name} {outcome}")
    return outcome


_PER = {-2: " s²", -1: " s", 0: "", 1: "/s", 2: "/s²"}
"""By order of a time derivative: what is added to a unit to get the unit of the derivative, such as "/s"."""


@dataclass(frozen=True)
class Unit:
    """A unit of displacement, or of velocity or acceleration.

    name: as in study files and options. base: unit in which we compute: rad, m, or the unit itself for a sensor of
    unknown scale. factor: size of this unit in the base unit, such as 0.001 for mm. quantity: "velocity" or
    "acceleration" if it is a unit of this quantity (rpm, g); None for a unit of displacement. written: other spellings
    in column names, in small letters.
    """

    name: str
    base: str
    factor: float
    quantity: str | None = None
    written: tuple[str, ...] = ()

    @property
    def translates(self) -> bool:
        """Return whether the displacement is not an angle, so that the restoring laws of pendulums do not apply."""
        return self.base != "rad"

    @property
    def physical(self) -> bool:
        """Return whether the displacement is an angle or a length, and not the output of a sensor of unknown scale.

        If so, forces and energies can be computed from the inertia.
        """
        return self.base in ("rad", "m")

    @property
    def scale(self) -> float:
        """Return 1 / factor, by which a value in the base unit is multiplied to get its value in this unit."""
        return 1.0 / self.factor

    @property
    def displacement(self) -> Unit:
        """Return the unit of displacement amplitudes: this unit, or rad or m for rpm, dps, g and the like."""
        return self if self.quantity is None else UNITS[self.base]

    def quantity_name(self, quantity: str) -> str:
        """Return the name of a recorded quantity as sentences use it, such as "velocity".

        For the quantity "angle", which means any displacement, it depends on the base of this unit: "angle" (rad),
        "position" (m) or "signal".
        """
        if quantity != "angle":
            return quantity
        return {"rad": "angle", "m": "position"}.get(self.base, "signal")

    def of(self, quantity: str) -> str:
        """Return the name of the unit of a quantity, such as "mm/s" for the velocity if this unit is mm.

        If this is a unit of velocity or acceleration, it is the unit of the derivative or integral: rpm/s for the
        acceleration if this unit is rpm, and "rpm" for the velocity.
        """
        return self.name + _PER[DERIVATIVES.get(quantity, 0) - DERIVATIVES[self.quantity or "angle"]]


DEGREES = ("degree", "degrees", "°", "grad", "grados", "gradi", "degré", "degrés", "degres")
"""Ways of writing degrees in column names."""
UNITS = {
    unit.name: unit
    for unit in (
        Unit("rad", "rad", 1.0, None, ("radian", "radians", "radiant")),
        Unit("mrad", "rad", 1e-3, None, ("milliradian", "milliradians")),
        Unit("urad", "rad", 1e-6, None, ("µrad", "μrad", "microradian", "microradians")),
        Unit("deg", "rad", math.pi / 180, None, DEGREES),
        Unit("rpm", "rad", math.pi / 30, "velocity", ("1/min",)),
        Unit("dps", "rad", math.pi / 180, "velocity"),
        Unit("m", "m", 1.0, None, ("meter", "meters", "metre", "metres")),
        Unit("cm", "m", 1e-2, None, ("centimeter", "centimeters", "centimetre", "centimetres", "zentimeter")),
        Unit("mm", "m", 1e-3, None, ("millimeter", "millimeters", "millimetre", "millimetres")),
        Unit("um", "m", 1e-6, None, ("µm", "μm", "micron", "microns", "micrometer", "micrometre")),
        Unit("in", "m", 0.0254, None, ("inch", "inches")),
        Unit("ft", "m", 0.3048, None, ("foot", "feet")),
        Unit("g", "m", 9.80665, "acceleration", ("g0", "gn")),
        Unit("mg", "m", 9.80665e-3, "acceleration"),
        Unit("V", "V", 1.0, None, ("volt", "volts")),
        Unit("mV", "V", 1e-3, None, ("millivolt", "millivolts")),
        Unit("uV", "V", 1e-6, None, ("µV", "μV", "microvolt", "microvolts")),
        Unit("px", "px", 1.0, None, ("pixel", "pixels")),
        Unit("ustrain", "ustrain", 1.0, None, ("um/m", "µm/m", "μm/m", "µε", "με", "microstrain")),
        Unit("counts", "counts", 1.0, None, ("count", "adc", "lsb", "a.u.", "au", "arb. units", "arb.u.")),
    )
}
"""Units by name, as in study files and options."""
DECIBELS = ("dB", "dBm", "dBV", "dBu", "dBmV", "dBuV", "dBW", "dBA", "dBFS", "dBc")
"""Decibel units in which the level of an envelope may be given, 20 log10 of the amplitude."""


def unit_named(name: str) -> Unit:
    """Return the unit with a name.

    A name that is not in `UNITS`, such as dBm of an envelope, gives a unit that is its own base.
    """
    return UNITS.get(name) or Unit(name, name, 1.0)


def quantity_unit(unit: str, quantity: str) -> str:
    """Return the name of a quantity's unit, such as "mm/s" for the unit "mm" and the quantity "velocity".

    unit: name of the unit of the displacement. Raises KeyError if it is not in `UNITS`.
    """
    return UNITS[unit].of(quantity)


def level_unit(unit: str) -> str:
    """Return the unit of an envelope's levels: "dB of 1 V" for unit "V"; a unit of DECIBELS is returned unchanged."""
    return unit if unit in DECIBELS else f"dB of 1 {unit}"
