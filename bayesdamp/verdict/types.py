"""A verdict: what is said of one record, or of one specimen, as values."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from bayesdamp.calls import Told
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
    Estimate,
    FrequencyAt,
    Grade,
    Interval,
    Mode,
    Motion,
    OverLaw,
    Rival,
    Share,
    Window,
)
from bayesdamp.verdict.tables import ratios_table

if TYPE_CHECKING:
    import pandas as pd


_PLAIN_COLUMNS = (
    "record", "quantity", "decided", "damping", "probability", "restoring", "restoring_probability", "unexplained_pct",
    "noise_pct", "midline_drift_pct", "probability_exact", "power_law", "sentence",
)  # fmt: skip
"""Fields that are columns of verdicts.csv as they are."""


@dataclass(frozen=True, repr=False)
class Verdict(Told):
    """What is said of one record, or of several of one specimen; it prints as its sentence. The file `verdict.json`
    holds a list of these.

    records: how many it is said of. decided: whether one damping is named without reservation. motion, modes: of a
    record that is no free decay of one oscillator, what it is and its oscillations, the largest first. deviation:
    energy-weighted mean of the relative deviation from the law; over_law: where one of the ratios' amplitudes is surely
    further from it than a law may be, the damping there over the law's. unnamed: share of the energy that no named law
    explains. unexplained_pct, noise_pct: root mean square beyond the noise, and of the noise, in % of the amplitude.
    frequency: of small oscillations, by the restoring law, None where the record does not determine it; frequency_at:
    at the last of the ratios' amplitudes. restoring_deviation: like deviation, of the restoring law. law_free:
    whether damping_ratio and frequency_at are measured without a law, because none is the answer; contradicted: whether
    that is because the best law contradicts them.
    midline_drift_pct: by how much the midline moves over the record, in % of the first amplitude, 0 where that is not
    seen. Of several records next_record is the damping ratio that one more would have, and spread the relative standard
    deviation of the damping between them.

    quantity: what the record holds of the motion: angle (or displacement), velocity, acceleration, or envelope. Of an
    envelope alone: rate, of decay, the law's, mean over the first half of the fall in dB, and quality_factor of it
    where the frequency is known; decay_rate and quality_factor_at, as they were at the amplitudes of damping_ratio,
    largest first; deviation is the root mean square over the decay; probability_exact: that the law holds exactly;
    power_law: log Bayes factor of one power of the amplitude against the sums. Of several envelopes next_value is the
    quality_factor, else the rate, that one more would have, and standardised the mean square of the standardised
    differences of their own values, 1 where their intervals are honest.
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
    motion: Motion | None = None
    modes: tuple[Mode, ...] = ()
    over_law: OverLaw | None = None
    window: Window | None = None
    averages: Averages | None = None
    quantity: str = "angle"
    rate: Estimate | None = None
    quality_factor: Estimate | None = None
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
        """Of every damping that was weighed, the one that is named first."""
        return {self.damping: self.probability, **{r.damping: r.probability for r in self.rivals}}

    def summary(self) -> pd.DataFrame:
        """One row, with the columns of verdicts.csv."""
        import pandas as pd

        return pd.DataFrame([self.row()])

    def row(self) -> dict[str, object]:
        """A line of verdicts.csv: a column each for three amplitudes, and for the probability of each term."""
        found: dict[str, object] = {name: getattr(self, name) for name in _PLAIN_COLUMNS}
        found |= {s.term: s.probability for s in self.energy}
        found |= {
            "grade": str(self.grade),
            "rivals": " ".join(f"{r.damping}:{r.probability:.4g}" for r in self.rivals),
            "energy": " ".join(f"{s.term}:{s.share:.4g}({s.low:.4g},{s.high:.4g})" for s in self.energy),
            "other_forms": " ".join(
                f"{b.form.replace(' ', '_')}:{b.share_below:.4g}" for b in self.other_forms
            ),
            "remarks": " ".join(self.remarks),
        }
        values = ("frequency", "frequency_at", "exponent", "deviation", "unnamed", "spread")
        for name in (*values, "rate", "quality_factor"):
            one = getattr(self, name)
            if one is not None:
                found |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
            if isinstance(one, Estimate):
                found |= {f"{name}_sd_noise": one.sd_noise, f"{name}_sd_law": one.sd_law}
        for i, ratio in enumerate(self.damping_ratio[:3], start=1):
            found |= {f"amplitude_{i}": ratio.amplitude, f"unit_{i}": ratio.unit}
            found |= {f"ratio_{i}": ratio.value, f"ratio_{i}_low": ratio.low, f"ratio_{i}_high": ratio.high}
            found |= {f"ratio_{i}_sd_noise": ratio.sd_noise, f"ratio_{i}_sd_law": ratio.sd_law}
        for i, ratio in enumerate(self.next_record[:3], start=1):
            found |= {f"ratio_{i}_next_low": ratio.low, f"ratio_{i}_next_high": ratio.high}
        if self.window is not None:
            found |= {"start": self.window.start, "stop": self.window.stop, "cycles": self.window.cycles}
        return found

    def _repr_html_(self) -> str:
        return ratios_table(self.damping_ratio, self.sentence).__html__()

    def to_dict(self) -> dict[str, object]:
        """As plain values, without provenance, with the version of the fields; what is not known is None."""
        found = {"schema": VERDICT_SCHEMA, **split(self)}
        found.pop("provenance")
        return _plain(found)  # type: ignore[return-value]

    @classmethod
    def from_dict(cls, given: Mapping[str, Any]) -> Self:
        """The inverse of `to_dict`."""
        return join(cls, {name: value for name, value in given.items() if name != "schema"})

    def to_json(self) -> str:
        """As `verdict.json` has it, but with amplitudes in this verdict's own unit."""
        return json.dumps(self.to_dict(), indent=1, ensure_ascii=False)

    def save(self, path: str | Path) -> Path:
        """Write it as JSON, all of it or nothing; the path. Raises InputError where it cannot be written."""
        return save_bytes(path, f"{self.to_json()}\n".encode())

    @classmethod
    def load(cls, path: str | Path, record: str | None = None) -> Self:
        """What `save` wrote, or one of the verdicts in a run's verdict.json: the only one, or that of `record`.

        Raises InputError where the file holds none, or several and no `record` says which.
        """
        try:
            found = json.loads(Path(path).read_text(encoding="utf-8"))
            every = [cls.from_dict(v) for v in (found if isinstance(found, list) else [found])]
        except FileNotFoundError:
            raise InputError(
                f"{path}: no such file; give one that a verdict's save() or a run wrote"
            ) from None
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            raise InputError(f"{path}: is no verdict; give what a verdict's save() or a run wrote") from None
        names = ", ".join(v.record for v in every)
        chosen = every if record is None else [v for v in every if v.record == record]
        if len(chosen) != 1:
            raise InputError(
                f"{path}: holds verdicts of {names or 'no record'}; record= must name one of them"
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
