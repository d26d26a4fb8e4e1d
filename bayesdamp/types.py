"""The values that pass from one stage to the next: frozen, with hardly any behaviour."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Self

from bayesdamp.serial import join

if TYPE_CHECKING:
    import numpy as np

OK = "ok"
VERDICT_SCHEMA = 1
"""Version of the objects of verdict.json: it increases when a field is renamed, removed, or changes its meaning."""
LAW_MARK = "@"
"""Separates a damping sum from its restoring law where a study compares several laws."""
_OPTIONS = {"value": "angle", "channels": "channel"}
"""The command's options whose names differ from the arguments of `read`."""


class BayesdampError(Exception):
    """Base of the errors that a user can correct; the text is one clear line."""


class InputError(BayesdampError):
    """The input is wrong: the text contains where, what, and what would be right (exit status 2).

    what: the fault. where: the file, the record, the option or the argument; at: the place in it, such as a line; both
    may be empty. arguments: those of `read` that resolve it, which the text names as the command's options. likely: the
    likeliest values of some of them.
    """

    def __init__(
        self,
        what: str,
        where: str = "",
        at: str = "",
        arguments: Sequence[str] = (),
        likely: Mapping[str, str] | None = None,
    ) -> None:
        self.what, self.where, self.at, self.arguments = what, where, at, tuple(arguments)
        self.likely = dict(likely or {})
        place = ", ".join(filter(None, (where, at)))
        options = ", ".join(f"--{_OPTIONS.get(a, a).replace('_', '-')}" for a in self.arguments)
        super().__init__((f"{place}: {what}" if place else what) + (f" ({options})" if options else ""))

    def naming(self, name: Callable[[str], str]) -> InputError:
        """Return the error with arguments named by a function, for example as keywords or keys of a study."""
        named = ", ".join(map(name, self.arguments))
        return InputError(f"{self.what} ({named})" if named else self.what, self.where, self.at)


class Refusal(BayesdampError):  # noqa: N818 - a method's answer, not an error
    """A method cannot work on this record; the text is the sentence in the tables."""


Fact = str | float


@dataclass(frozen=True)
class FreeDecay:
    """A free decay in a record: start and stop in s of the record's own times."""

    start: float
    stop: float


@dataclass(frozen=True)
class Provenance:
    """How a record was read, and what was done to it.

    warnings: sentences that a user must know; notes: sentences on what was done; header_lines: how many were skipped.
    facts: metadata in the file. time_column, value_column: labels in the file; time_unit: the source of the unit of the
    times, "given", "file", or empty; first_line: line of the file (from 1) with the first row of numbers;
    constant_columns: columns that were left out. unit: of the record, a name in UNITS. start, stop: of the part that is
    used, in s of the record's own times; offset: what was subtracted from all values (unit of the signal's y); decays:
    all free decays of the record, with the one that is used. more: numbers and words for run.json alone.
    """

    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    header_lines: int = 0
    facts: Mapping[str, Fact] = field(default_factory=dict)
    time_column: str = ""
    value_column: str = ""
    time_unit: str = ""
    first_line: int | None = None
    constant_columns: tuple[str, ...] = ()
    unit: str = ""
    start: float = 0.0
    stop: float | None = None
    offset: float = 0.0
    decays: tuple[FreeDecay, ...] = ()
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def sentences(self) -> tuple[str, ...]:
        """Return the sentences for the user: warnings, the number of header lines, notes."""
        head = self.header_lines
        lines = [f"Beware: {text}" for text in self.warnings]
        lines += [f"{head} header line{'s' if head != 1 else ''} skipped."] if head else []
        return (*lines, *self.notes)

    def to_dict(self) -> dict[str, Any]:
        """Return it as in run.json, without empty fields; `of` is the inverse."""
        values = asdict(self)
        always = {name: list(values.pop(name)) for name in ("warnings", "notes")}
        more = values.pop("more")
        return {**more, **{n: v for n, v in values.items() if v not in ((), {}, "", None)}, **always}

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """Return the provenance of which `to_dict` made this, also after it was a file."""
        own = {f.name for f in fields(cls)} - {"more"}
        values = {name: value for name, value in given.items() if name in own and value is not None}
        more = {name: value for name, value in given.items() if name not in own}
        return join(cls, {**values, "more": more})


@dataclass(frozen=True, eq=False)
class Signal:
    """A record after cleaning, in SI units, without the truth; equal only to itself.

    t: times in s, shape (n,), strictly increasing, t[0] = 0 at the first sample.
    y: the recorded quantity, shape (n,): rad or m, per s or per s² for velocity or acceleration.
    quantity: "angle", "velocity" or "acceleration".
    unit: "rad" or "m": the unit of the displacement itself.
    step: the recording step (quantisation) in the unit of y, 0 where none is detected.
    provenance: how it was read and what was done to it.
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
        """Whether the samples are equally spaced to a thousandth of the spacing."""
        gaps = self.t[1:] - self.t[:-1]
        return bool((abs(gaps - gaps.mean()) <= 1e-3 * gaps.mean()).all())


@dataclass(frozen=True)
class FeaturesSeen:
    """Features of an oscillation, in numbers.

    rest: the midline of the last half of the turning points (rad or m; 0 for velocity and acceleration).
    amplitude, final_amplitude: displacement amplitude at the first and last sample (rad or m).
    frequency (rad/s) and period (s): mean over the record, with more weight where the crossings are sharp.
    cycles: cycles in the record, as far as turning points stand out of the noise.
    samples_per_cycle: samples in a mean period.
    roughness: sd of the noise, in the unit of the recorded quantity.
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

    text: in sentences and tables. math: in figures. meaning: in words.
    """

    text: str
    math: str
    meaning: str


@dataclass(frozen=True)
class System:
    """What is known of the oscillator, without the truth of what is estimated.

    restoring: name of the restoring law.
    known: parameter name to its specified value (restoring parameters, theta0, omega0, epsilon, noise_sd, ...).
    free: parameter name to a prior, or None for the default prior.
    amplitude, frequency: the study's reference amplitude (unit of displacement) and frequency (rad/s).
    """

    restoring: str
    known: Mapping[str, float] = field(default_factory=dict)
    free: Mapping[str, object | None] = field(default_factory=dict)
    amplitude: float | None = None
    frequency: float | None = None


@dataclass(frozen=True)
class Estimate:
    """A point estimate of one method at one stage.

    values: parameter name to value, only those that the method itself computes (SI units).
    stderr: parameter name to the method's own standard error, where it has one.
    trace: named convergence curves, each an array.
    details: further results of the method (selected terms, eigenvalues, a Pareto front, a learnt force), as strings,
    numbers and lists of these.
    """

    estimator: str
    stage: str
    values: Mapping[str, float] = field(default_factory=dict)
    stderr: Mapping[str, float] = field(default_factory=dict)
    trace: Mapping[str, np.ndarray] = field(default_factory=dict)
    details: Mapping[str, object] = field(default_factory=dict)
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK


@dataclass(frozen=True)
class Seed:
    """The start of a search for the mode.

    source: of the values: an estimator, or in words a part of the record or a fit; stage: the estimator's. drawn:
    whether they are a draw from the prior. grown: whether the start was then refined along a window that grew from two
    cycles.
    """

    source: str
    stage: str = ""
    drawn: bool = False
    grown: bool = False


@dataclass(frozen=True)
class PartialFit:
    """The mode on a part of the record, from start to stop in s.

    values, sd: of the parameters, by Laplace's approximation, as is the part's log evidence (nats).
    """

    label: str
    start: float
    stop: float
    values: Mapping[str, float]
    sd: Mapping[str, float]
    log_evidence: float = float("nan")


@dataclass(frozen=True)
class Forecast:
    """The prediction of the second half of a record from the first.

    rms, expected: of its error, and the expected one, in the record's unit. coverage: share inside the 95 % interval.
    log_predictive: log density given the first half (nats).
    """

    rms: float
    expected: float
    coverage: float
    log_predictive: float


@dataclass(frozen=True)
class AddedForm:
    """The model with another form of damping: its log Bayes factor in nats against the model without it."""

    words: str
    log_bayes: float


@dataclass(frozen=True)
class FitCheck:
    """The checks of a model at its mode.

    Attributes
    ----------
    windows
        Fits of the whole record and of three halves of it.
    rms, share
        Of the residuals, in the unit of the record, and as a share of half the fit's range.
    residual_autocorrelation
        Of the residuals at one lag.
    predictive_p, tails_p
        Posterior predictive p of the structure in whitened residuals, and of their kurtosis.
    line_p
        Chance of the part of their spectrum that stands out most.
    form_p
        Chance of the force, of those that no candidate has, which they show most.
    kurtosis
        Of the whitened residuals, in excess of a normal's.
    window_spread, window_p
        Largest shift of a damping coefficient between a half and the whole record, in the sds that it has by chance,
        and the chance of a shift as large.
    forecast
        Of the second half by the first, where the first half determines it.
    rivals
        The model with other forms of damping added.
    verdict
        Whether the model fits, and why not.
    """

    windows: tuple[PartialFit, ...] = ()
    rms: float = float("nan")
    share: float = float("nan")
    residual_autocorrelation: float = float("nan")
    predictive_p: float = float("nan")
    line_p: float = float("nan")
    form_p: float = float("nan")
    kurtosis: float = float("nan")
    tails_p: float = float("nan")
    window_spread: float = float("nan")
    window_p: float = float("nan")
    forecast: Forecast | None = None
    rivals: tuple[AddedForm, ...] = ()
    verdict: str = ""


@dataclass(frozen=True)
class NestedRatio:
    """Log Bayes factor (nats) of a model without a damping term against the one with it, by Savage and Dickey.

    stderr: its standard error. outcome: `ok`, or why it is not valid.
    """

    log_bayes_factor: float = float("nan")
    stderr: float = float("nan")
    outcome: str = OK


@dataclass(frozen=True)
class Ratio:
    """Equivalent viscous damping ratio at an amplitude (rad or m).

    value: median. low, high: 95 % interval. sd_noise, sd_law: parts of its standard deviation.
    """

    amplitude: float
    value: float
    low: float
    high: float
    sd_noise: float
    sd_law: float


@dataclass(frozen=True)
class ChainStart:
    """The starting point of a chain.

    seed: its source. seed_distance, distance: of the seed and of the point from the mode, in posterior sds. shift: the
    largest distance of the chain's mean from that of all chains, in posterior sds.
    """

    seed: Seed
    seed_distance: float
    distance: float
    shift: float


FRICTION_WIDTH = 0.02
"""Default of the velocity ε within which friction changes its sign, as a share of the peak velocity (conventional)."""


@dataclass(frozen=True)
class Reference:
    """Reference amplitude (rad or m) and angular frequency (rad/s) of a study: prior widths scale with it."""

    amplitude: float
    frequency: float

    def scales(self, rest: float) -> dict[str, float]:
        """Return the scales that damping terms may use, by name; rest: where the motion rests, rad or m."""
        return {
            "rest": rest,
            "reference_velocity": self.peak_velocity,
            "reference_amplitude": self.amplitude,
        }

    @property
    def peak_velocity(self) -> float:
        """Return amplitude times frequency, rad/s or m/s."""
        return self.amplitude * self.frequency

    @property
    def friction_width(self) -> float:
        """Return the default of ε, rad/s or m/s."""
        return FRICTION_WIDTH * self.peak_velocity


@dataclass(frozen=True)
class Friction:
    """A width of friction ε (rad/s or m/s), with its posterior probability.

    coefficients, further: of all damping terms at this width, and their further parameters.
    """

    epsilon: float
    weight: float
    coefficients: tuple[float, ...]
    further: tuple[float, ...] = ()


@dataclass(frozen=True)
class Posterior:
    """Draws of a posterior: draws[chain, draw, parameter] in natural units.

    summaries: of each parameter. starts: of the chains. divergences: number of diverging transitions, None for samplers
    without them. evaluations: of the likelihood. ensembles: number of groups of chains that share their moves.
    effective: number of draws of the posterior that independent draws of an approximation are worth. running: the
    parameters whose running estimates are in the arrays, `running/...`. diagnostics: further ones of the sampler.
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
    starts: tuple[ChainStart, ...] = ()
    divergences: int | None = None
    evaluations: int = 0
    ensembles: int | None = None
    effective: float | None = None
    running: tuple[str, ...] = ()
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False)


@dataclass(frozen=True)
class Evidence:
    """Log marginal likelihood of one model by one method (nats), with its standard error and diagnostic.

    arrays: for further use, such as draws and their weights.
    """

    model: str
    method: str
    log_evidence: float = float("nan")
    stderr: float = float("nan")
    diagnostic: str = ""
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)


def candidate_name(damping: str, restoring: str = "") -> str:
    """Return the name of a candidate: `viscous+coulomb@pendulum`, or the damping sum where no law is given."""
    return f"{damping}{LAW_MARK}{restoring}" if restoring else damping


def candidate_parts(name: str) -> tuple[str, str]:
    """Return damping sum and restoring law of a candidate; the law is empty where the name has none."""
    damping, _, restoring = name.partition(LAW_MARK)
    return damping, restoring


def summed(probabilities: Mapping[str, float], part: int = 0) -> dict[str, float]:
    """Sum candidates' probabilities over restoring laws, by damping, the likeliest first.

    With `part` 1 they are summed over dampings, by law.
    """
    sums: dict[str, float] = {}
    for name, p in probabilities.items():
        key = candidate_parts(name)[part]
        sums[key] = sums.get(key, 0.0) + p
    return dict(sorted(sums.items(), key=lambda item: -item[1]))


@dataclass(frozen=True)
class Problem:
    """The task of an estimator: these damping terms, with what is known of the system."""

    damping: tuple[str, ...]
    system: System
