"""Define the verdict: the answer on one record, or on one specimen, as values."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bayesdamp.calls import CheckedMethods
from bayesdamp.serial import join, split
from bayesdamp.store.files import save_bytes
from bayesdamp.types import VERDICT_SCHEMA, InputError
from bayesdamp.verdict.parts import (
    NAN,
    AtAmplitude,
    Averages,
    Bound,
    Coefficient,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    Measured,
    MotionKind,
    Oscillation,
    OverLaw,
    Rival,
    Share,
    UsedWindow,
)
from bayesdamp.verdict.tables import ratios_table

if TYPE_CHECKING:
    import pandas as pd


_PLAIN_COLUMNS = (
    "record", "quantity", "decided", "damping", "probability", "restoring", "restoring_probability", "unexplained_pct",
    "noise_pct", "midline_drift_pct", "probability_exact", "power_law", "sentence",
)  # fmt: skip
"""Fields that are columns of verdicts.csv as they are."""
_INTERVALS = (
    "frequency", "frequency_at", "exponent", "deviation", "unnamed", "spread", "rate", "quality_factor",
)  # fmt: skip
"""Fields whose value, low and high are columns of verdicts.csv."""


@dataclass(frozen=True, repr=False)
class Verdict(CheckedMethods):
    """The answer on one record, or on several of one specimen; it prints as its sentence.

    The file `verdict.json` holds a list of these. A number that is not known is NaN, or None.

    Attributes
    ----------
    record, records
        Name of the record or specimen, and the number of records.
    grade
        How well the laws hold.
    decided
        Whether one damping is named without reservation.
    damping, probability, rivals
        The damping sum that is named first, its probability, and the others that were weighed.
    restoring, restoring_probability
        The most probable restoring law.
    frequency
        Natural frequency of small oscillations in Hz, by the restoring law; None where the record does not determine
        it.
    frequency_at
        Frequency at the last of the amplitudes of `damping_ratio`.
    exponent
        Power of the velocity with which the damping force grows.
    damping_ratio
        Equivalent viscous damping ratios at amplitudes of the record.
    energy, other_forms
        Each term's share of the dissipated energy, and upper limits for absent forms.
    deviation, restoring_deviation
        Energy-weighted mean of the relative deviation from the damping law, and from the restoring law. Of an envelope
        the root mean square over the decay.
    over_law
        The damping over that of its law, at one of the amplitudes where it is surely further off than a law may be.
    unnamed
        Share of the energy that no named law explains.
    unexplained_pct, noise_pct
        Root mean square beyond the noise, and of the noise, in % of the amplitude.
    midline_drift_pct
        Drift of the midline over the record in % of the first amplitude; 0 where there is none.
    law_free, contradicted
        Whether damping_ratio and frequency_at are measured without a law, because no law is the answer; and whether
        that is because the best law contradicts them.
    coefficients
        Parameters of the damping that is named and of the restoring law.
    motion, modes
        For a record that is not a free decay of one oscillator: what it is, and its oscillations, the largest first.
    window, averages
        The part of the record that was used; and the averaging, where very many cycles were averaged.
    quantity
        What the record holds of the motion: angle (or displacement), velocity, acceleration, or envelope.
    rate, quality_factor
        For an envelope: the law's mean rate of decay over the first half of the fall in dB, and Q of it where the
        frequency is known.
    decay_rate, quality_factor_at
        For an envelope: the same at the amplitudes of damping_ratio, the largest first.
    probability_exact, power_law
        For an envelope: the probability that the law holds exactly, and the log Bayes factor of one power of the
        amplitude against the sums.
    spread
        For several records: the relative standard deviation of the damping between them.
    next_record, next_value
        For several records: the damping ratio that one more record would have; for envelopes its quality factor, or
        else its rate.
    standardised
        For several envelopes: the mean square of the standardised differences of their own values, 1 where their
        intervals are honest.
    remarks, sentence
        Reservations, the largest first; and the answer in one sentence.
    provenance
        How the verdict was computed; not stored.
    """

    record: str
    grade: Grade
    decided: bool
    damping: str
    probability: float
    rivals: tuple[Rival, ...] = ()
    restoring: str = ""
    restoring_probability: float = NAN
    frequency: Interval | None = None
    exponent: Interval | None = None
    damping_ratio: tuple[DampingRatio, ...] = ()
    next_record: tuple[DampingRatio, ...] = ()
    spread: Interval | None = None
    energy: tuple[Share, ...] = ()
    other_forms: tuple[Bound, ...] = ()
    deviation: Interval | None = None
    unnamed: Interval | None = None
    unexplained_pct: float = NAN
    noise_pct: float = NAN
    midline_drift_pct: float = NAN
    frequency_at: FrequencyAt | None = None
    restoring_deviation: Interval | None = None
    law_free: bool = False
    contradicted: bool = False
    coefficients: tuple[Coefficient, ...] = ()
    motion: MotionKind | None = None
    modes: tuple[Oscillation, ...] = ()
    over_law: OverLaw | None = None
    window: UsedWindow | None = None
    averages: Averages | None = None
    quantity: str = "angle"
    rate: Measured | None = None
    quality_factor: Measured | None = None
    decay_rate: tuple[AtAmplitude, ...] = ()
    quality_factor_at: tuple[AtAmplitude, ...] = ()
    probability_exact: float = NAN
    power_law: float = NAN
    next_value: Interval | None = None
    standardised: float = NAN
    remarks: tuple[str, ...] = ()
    records: int = 1
    sentence: str = ""
    provenance: Mapping[str, object] = field(default_factory=dict, repr=False)

    def __repr__(self) -> str:
        return self.sentence

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of every damping that was weighed, that of the named one first."""
        return {self.damping: self.probability, **{r.damping: r.probability for r in self.rivals}}

    def summary(self) -> pd.DataFrame:
        """Return one row with the columns of verdicts.csv."""
        import pandas as pd

        return pd.DataFrame([self.row()])

    def row(self) -> dict[str, object]:
        """Return a line of verdicts.csv: columns for each of three amplitudes, and one for each term's probability."""
        row: dict[str, object] = {name: getattr(self, name) for name in _PLAIN_COLUMNS}
        row |= {s.term: s.probability for s in self.energy}
        row["grade"] = str(self.grade)
        row["rivals"] = " ".join(f"{r.damping}:{r.probability:.4g}" for r in self.rivals)
        row["energy"] = " ".join(f"{s.term}:{s.share:.4g}({s.low:.4g},{s.high:.4g})" for s in self.energy)
        row["other_forms"] = " ".join(
            f"{b.form.replace(' ', '_')}:{b.share_below:.4g}" for b in self.other_forms
        )
        row["remarks"] = " ".join(self.remarks)

        def add(name: str, value: Interval | FrequencyAt | Measured | DampingRatio | None) -> None:
            if value is not None:
                row.update({name: value.value, f"{name}_low": value.low, f"{name}_high": value.high})
            if isinstance(value, Measured | DampingRatio):
                row.update({f"{name}_sd_noise": value.sd_noise, f"{name}_sd_law": value.sd_law})

        for name in _INTERVALS:
            add(name, getattr(self, name))
        for i, ratio in enumerate(self.damping_ratio[:3], start=1):
            row |= {f"amplitude_{i}": ratio.amplitude, f"unit_{i}": ratio.unit}
            add(f"ratio_{i}", ratio)
        for i, ratio in enumerate(self.next_record[:3], start=1):
            row |= {f"ratio_{i}_next_low": ratio.low, f"ratio_{i}_next_high": ratio.high}
        if self.window is not None:
            row |= {"start": self.window.start, "stop": self.window.stop, "cycles": self.window.cycles}
        return row

    def _repr_html_(self) -> str:
        return ratios_table(self.damping_ratio, self.sentence).__html__()

    def to_dict(self) -> dict[str, object]:
        """Return plain values with the version of the fields, without provenance; what is not known is None."""
        fields = {"schema": VERDICT_SCHEMA, **split(self)}
        fields.pop("provenance")
        return _plain(fields)  # type: ignore[return-value]

    @classmethod
    def from_dict(cls, given: Mapping[str, Any]) -> Self:
        """Make a verdict from what `to_dict` returned."""
        return join(cls, {name: value for name, value in given.items() if name != "schema"})

    def to_json(self) -> str:
        """Return the JSON of `verdict.json`, but with amplitudes in this verdict's own unit."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False)

    def save(self, path: str | Path) -> Path:
        """Write the verdict as JSON, completely or not at all, and return the path.

        Raises
        ------
        InputError
            Where the file cannot be written.
        """
        return save_bytes(path, f"{self.to_json()}\n".encode())

    @classmethod
    def load(cls, path: str | Path, record: str | None = None) -> Self:
        """Read what `save` wrote, or one of the verdicts in a run's verdict.json.

        Parameters
        ----------
        path
            The file.
        record
            Name of the record whose verdict is wanted; not needed where the file holds only one.

        Raises
        ------
        InputError
            Where the file holds no verdict, or several and `record` does not name one.
        """
        try:
            content = json.loads(Path(path).read_text(encoding="utf-8"))
            verdicts = [cls.from_dict(v) for v in (content if isinstance(content, list) else [content])]
        except FileNotFoundError:
            raise InputError(
                f"{path}: no such file; give one that a verdict's save() or a run wrote"
            ) from None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path}: is not a verdict; give a file that a verdict's save() or a run wrote"
            ) from None
        chosen = verdicts if record is None else [v for v in verdicts if v.record == record]
        if len(chosen) != 1:
            names = ", ".join(v.record for v in verdicts)
            raise InputError(
                f"{path}: holds verdicts on {names or 'no record'}; record= must name one of them"
            )
        return chosen[0]


def _plain(value: object) -> object:
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value
