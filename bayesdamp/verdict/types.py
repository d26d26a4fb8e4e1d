"""Define the verdict (the answer on one record or one specimen), and read and write its files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bayesdamp.calls import CheckedMethods
from bayesdamp.formatting import data_frame
from bayesdamp.serial import join, split
from bayesdamp.store.files import save_bytes, write_json, write_table
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
    MeasuredNumber,
    MotionKind,
    Oscillation,
    OverLaw,
    Rival,
    Share,
    UsedWindow,
    ratios_table,
)

if TYPE_CHECKING:
    import pandas as pd


VERDICT_JSON, VERDICT_TABLE = "verdict.json", "verdicts.csv"
"""Names of the files of a run that contain its verdicts."""
_PARTS = {"": "value", "_low": "low", "_high": "high", "_sd_noise": "sd_noise", "_sd_law": "sd_law"}
"""Attribute of a number with an interval, by the suffix of the column in verdicts.csv that contains it."""
_RATIOS = 3
"""Number of damping ratios of a verdict in verdicts.csv; further ones are left out."""


def _cells(name: str, value: Any) -> dict[str, object]:
    """Return the cells of verdicts.csv, by column, for the value of the field `name`.

    A number with an interval becomes a cell for each of its `_PARTS`. Rivals, other forms, energies and remarks become
    one text each. For energies there is also a cell for each term, with the probability that the damping contains it.
    Of damping ratios only the first `_RATIOS` are used.
    """
    match name:
        case "rivals":
            return {name: " ".join(f"{r.damping}:{r.probability:.4g}" for r in value)}
        case "other_forms":
            return {name: " ".join(f"{b.form.replace(' ', '_')}:{b.share_below:.4g}" for b in value)}
        case "energy":
            text = " ".join(f"{s.term}:{s.share:.4g}({s.low:.4g},{s.high:.4g})" for s in value)
            return {name: text, **{s.term: s.probability for s in value}}
        case "damping_ratio" | "next_record":
            cells: dict[str, object] = {}
            for i, r in enumerate(value[:_RATIOS], 1):
                if name == "next_record":
                    cells |= {f"ratio_{i}_next_low": r.low, f"ratio_{i}_next_high": r.high}
                else:
                    cells |= {f"amplitude_{i}": r.amplitude, f"unit_{i}": r.unit, **_cells(f"ratio_{i}", r)}
            return cells
        case "window":
            return {"start": value.start, "stop": value.stop, "cycles": value.cycles}
        case "remarks":
            return {name: " ".join(value)}
    parts = {name + end: getattr(value, part) for end, part in _PARTS.items() if hasattr(value, part)}
    return parts or {name: value}


@dataclass(frozen=True, repr=False)
class Verdict(CheckedMethods):
    """The answer on one record, or on several records of one specimen (the recorded object); it prints as its sentence.

    The file `verdict.json` contains a list of verdicts. An unknown number is NaN or None.

    Attributes
    ----------
    record, records
        Name of the record or specimen, and the number of records.
    grade
        How well the damping and restoring laws hold, or why none was compared (see `Grade`).
    decided
        Whether the record decides which damping it is; False if other dampings remain possible, or no law is the answer
        (`Grade.DEVIATES`).
    damping, probability, rivals
        The most probable of the compared sums of damping terms, with its terms joined by + ("" if none was compared);
        its probability (NaN if none was compared; for the limit see `thresholds.CAP`); and all other dampings with
        their probabilities. The rivals include forms of damping outside the compared sums, which may be more probable.
    restoring, restoring_probability
        Name and probability of the most probable restoring law; "" and NaN for an envelope.
    frequency
        Natural frequency of small oscillations in Hz, from the restoring law; None if the record does not determine or
        contradicts it, or if those of several records differ. For an envelope: the frequency of its oscillation, if it
        was specified. For a record that is not a free decay: the frequency of its largest oscillation.
    frequency_at
        Frequency in Hz at the smallest amplitude of `damping_ratio` (or close to it; the amplitude is included); None
        for several records. It may be measured without a law although `law_free` is False: if the measured value is
        more precise than that of the laws, contradicts it, or is the only one.
    exponent
        Exponent p of the damping force fitted as one power |v|^p of the velocity, with its 95 % interval.
    damping_ratio
        Equivalent viscous damping ratios (fractions) at the requested amplitudes in their order, by default at up to
        three amplitudes of the record, the largest first.
    energy, other_forms
        The share of the energy that each compared term dissipates, whether it is in `damping` or not; and upper limits
        for the shares of forms of damping that are not in `damping`. Both are fractions; both are empty if `law_free`.
        For an envelope or a specimen, `other_forms` is empty.
    deviation, restoring_deviation
        Energy-weighted mean of the relative deviation from the damping law, and from the restoring law, as fractions
        with 95 % intervals; None if laws were assumed to hold exactly. For an envelope, `deviation` is the root mean
        square over the decay.
    over_law
        The damping divided by the damping of its law, at the amplitude where the 95 % interval of this ratio is
        furthest from 1. It is given only if the whole interval is above 1 + D or below 1/(1 + D), with D =
        `thresholds.DEVIATES`; otherwise None.
    unexplained_pct, noise_pct
        Rms of the unexplained residual, and of the noise of a sample, in % of the first amplitude (for an envelope, of
        the amplitude).
    midline_drift_pct
        Drift of the midline (signed) over the record in % of the first amplitude; 0 where it is not significant.
    law_free, contradicted
        Whether both damping_ratio and frequency_at are measured without assuming a law, because no law is the answer;
        and whether no law is the answer because the best damping law contradicts the measured damping ratios.
    coefficients
        Parameters of the damping that is named and of the restoring law, in base units (rad, m or the sensor's, and s);
        for an envelope see the unit of each. For a specimen, only those of the damping. Empty for several envelopes, or
        if `contradicted`.
    motion, modes
        For a record that is not a free decay of one oscillator: the kind of motion, and its oscillations, the largest
        first.
    window, averages
        The part of the record that was used; and the averaging over cycles, if the record has very many cycles.
    quantity
        The recorded quantity: angle (or displacement), velocity, acceleration, or envelope.
    rate, quality_factor
        For an envelope: the mean rate of decay of the amplitude in 1/s, over the first half of the decrease in dB,
        according to the damping law; and the quality factor Q with this rate, if the frequency is known.
    decay_rate, quality_factor_at
        For an envelope: decay rate and Q at the amplitudes of damping_ratio, the largest first. For several envelopes
        whose damping is not viscous: at three amplitudes that all of them have in common; rate and quality_factor are
        then those at the middle amplitude.
    probability_exact, power_law
        For an envelope: the probability that the damping law holds exactly; and the log Bayes factor (nats) of a single
        power of the amplitude against all compared sums of damping terms.
    spread
        For several records: the relative standard deviation of the damping between them, as a fraction.
    next_record, next_value
        For several records: predictions for one more record, with 95 % intervals. next_record: its damping ratios.
        next_value: for envelopes, its quality factor, or its decay rate if the frequency is not known.
    remarks, sentence
        Reservations, the largest first, then other information; and the answer in one sentence.
    """

    record: str
    grade: Grade
    decided: bool
    damping: str
    probability: float
    rivals: tuple[Rival, ...] = ()
    restoring: str = ""
    restoring_probability: float = NAN
    quantity: str = "angle"
    frequency: Interval | None = None
    frequency_at: FrequencyAt | None = None
    exponent: Interval | None = None
    damping_ratio: tuple[DampingRatio, ...] = ()
    next_record: tuple[DampingRatio, ...] = ()
    rate: MeasuredNumber | None = None
    quality_factor: MeasuredNumber | None = None
    energy: tuple[Share, ...] = ()
    other_forms: tuple[Bound, ...] = ()
    power_law: float = NAN
    probability_exact: float = NAN
    deviation: Interval | None = None
    spread: Interval | None = None
    unexplained_pct: float = NAN
    noise_pct: float = NAN
    midline_drift_pct: float = NAN
    window: UsedWindow | None = None
    remarks: tuple[str, ...] = ()
    sentence: str = ""
    # The fields up to here have columns in verdicts.csv, in this order.
    restoring_deviation: Interval | None = None
    law_free: bool = False
    contradicted: bool = False
    coefficients: tuple[Coefficient, ...] = ()
    motion: MotionKind | None = None
    modes: tuple[Oscillation, ...] = ()
    over_law: OverLaw | None = None
    averages: Averages | None = None
    decay_rate: tuple[AtAmplitude, ...] = ()
    quality_factor_at: tuple[AtAmplitude, ...] = ()
    next_value: Interval | None = None
    records: int = 1

    def __repr__(self) -> str:
        return self.sentence

    @property
    def probabilities(self) -> dict[str, float]:
        """Return the probabilities of all compared dampings and other forms, by name; `damping` is first."""
        return {self.damping: self.probability, **{r.damping: r.probability for r in self.rivals}}

    def summary(self) -> pd.DataFrame:
        """Return the verdict as a table with one row and the columns of verdicts.csv; see `row` for those left out."""
        return data_frame([self.row()])

    def row(self) -> dict[str, object]:
        """Return the cells of this verdict's row in verdicts.csv, by column, without those of fields that are None.

        `columns()` lists the columns; each other damping term in `energy` has a further one. Amplitudes are in this
        verdict's own unit.
        """
        row: dict[str, object] = {}
        for f in fields(self):
            value = getattr(self, f.name)
            row |= {} if value is None else _cells(f.name, value)
            if f.name == "sentence":
                break
        return row

    def _repr_html_(self) -> str:
        return ratios_table(self.damping_ratio, self.sentence).__html__()

    def to_dict(self) -> dict[str, object]:
        """Return the fields as JSON values by name, and the version of the schema; NaN and infinity become None."""
        return _plain({"schema": VERDICT_SCHEMA, **split(self)})  # type: ignore[return-value]

    @classmethod
    def from_dict(cls, given: Mapping[str, Any]) -> Self:
        """Restore a verdict from the dictionary that `to_dict` returned; None in place of a number becomes NaN."""
        return join(cls, {name: value for name, value in given.items() if name != "schema"})

    def to_json(self) -> str:
        """Return the verdict as JSON text: an object like those in `verdict.json`, with amplitudes in its own unit."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False)

    def save(self, path: str | Path) -> Path:
        """Write the JSON of `to_json` to a file, atomically, and return its path. An existing file is replaced.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        return save_bytes(path, f"{self.to_json()}\n".encode())

    @classmethod
    def load(cls, path: str | Path, record: str | None = None) -> Verdict:
        """Read a verdict from a file that `save` wrote, or one of the verdicts in the verdict.json of a run.

        Amplitudes are in the unit in which they were saved; in a verdict.json this is the base unit.

        Parameters
        ----------
        path
            The file.
        record
            Name of the record or specimen. If None, the file must contain exactly one verdict.

        Raises
        ------
        InputError
            If the file is missing, contains no verdict of this version, or does not contain exactly one verdict (on
            `record`, if it is given).
        """
        try:
            verdicts = load_verdicts(Path(path))
        except FileNotFoundError:
            raise InputError(
                f"{path}: no such file; give a file that a verdict's save() or a run wrote"
            ) from None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(
                f"{path}: does not contain a verdict of this version; give a file that save() or a run wrote"
            ) from None
        chosen = verdicts if record is None else [v for v in verdicts if v.record == record]
        if len(chosen) != 1:
            names = ", ".join(v.record for v in verdicts)
            raise InputError(
                f"{path}: contains verdicts on {names or 'no record'}; record= must name one of them"
            )
        return chosen[0]


_INTERVAL, _NUMBER = Interval(NAN, NAN, NAN), MeasuredNumber(NAN, NAN, NAN, NAN, NAN)
_RATIO = DampingRatio(NAN, "", NAN, NAN, NAN, NAN, NAN)
_FULL = Verdict(
    "", Grade.EXACT, False, "", NAN,
    frequency=_INTERVAL, frequency_at=FrequencyAt(NAN, "", NAN, NAN, NAN), exponent=_INTERVAL,
    damping_ratio=(_RATIO,) * _RATIOS, next_record=(_RATIO,) * _RATIOS, rate=_NUMBER, quality_factor=_NUMBER,
    energy=tuple(Share(term, NAN, NAN, NAN, NAN) for term in ("viscous", "coulomb", "quadratic")),
    deviation=_INTERVAL, spread=_INTERVAL, window=UsedWindow(NAN, NAN, NAN, ""),
)  # fmt: skip
"""A verdict without an answer that has a value in every column of verdicts.csv, from which `columns` gets their names.
Terms other than viscous, Coulomb and quadratic damping have a column only if they occur in a run."""


def columns() -> tuple[str, ...]:
    """Return the names of the columns of verdicts.csv, in the order of the fields of `Verdict`.

    Columns of terms other than viscous, Coulomb and quadratic damping are not included.
    """
    return tuple(_FULL.row())


def _plain(value: object) -> object:
    """Return a copy of a JSON value in which NaN and infinite numbers, at any depth, are replaced by None."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not isfinite(value):
        return None
    return value


def load_verdicts(path: Path) -> list[Verdict]:
    """Read the verdicts in a file that `save_verdicts` or `Verdict.save` wrote.

    Raises
    ------
    OSError
        If the file cannot be read.
    AttributeError, KeyError, TypeError, ValueError
        If the file does not contain verdicts.
    InputError
        If another version of the package wrote the file.
    """
    content = json.loads(path.read_text(encoding="utf-8"))
    verdicts = content if isinstance(content, list) else [content]
    if any(v["schema"] != VERDICT_SCHEMA for v in verdicts):
        raise InputError(f"{path}: was written by another version of bayesdamp; compute it again")
    return [Verdict.from_dict(v) for v in verdicts]


def save_verdicts(folder: Path, verdicts: Sequence[Verdict], shown: Sequence[Verdict] | None = None) -> None:
    """Write verdict.json and verdicts.csv into a run's folder.

    Parameters
    ----------
    folder
        The run's folder.
    verdicts
        Verdicts on the records in their order, then those on specimens. They are written to verdict.json unchanged.
    shown
        The same verdicts in the units of the records' files, for the table; `verdicts` by default.
    """
    write_json(folder / VERDICT_JSON, [v.to_dict() for v in verdicts])
    rows = [v.row() for v in shown or verdicts]
    names = columns()
    more = dict.fromkeys(s.term for v in verdicts for s in v.energy if s.term not in names)
    behind = names.index("quadratic") + 1
    write_table(folder / VERDICT_TABLE, (*names[:behind], *more, *names[behind:]), rows)
