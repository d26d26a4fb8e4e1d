"""Compare damping models on one record, or on several records of one specimen (the object that was recorded)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp import types
from bayesdamp.config.signals import canonical_models, check_laws
from bayesdamp.formatting import Table, data_frame
from bayesdamp.inference.deviation.findings import SENSOR
from bayesdamp.inference.deviation.sample_noise import noises_of
from bayesdamp.inference.noise import NOISES
from bayesdamp.interface.answer import Answer, answer, compare_models
from bayesdamp.interface.arguments import check_settings, known_and_priors, names_given
from bayesdamp.interface.envelopes import answer_envelope, specimen_of_envelopes
from bayesdamp.interface.result import GivenAxes, Result, get_axes, show_in_notebook
from bayesdamp.interface.signal import Signal
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.store.files import DAMPING_CURVES, save_bytes
from bayesdamp.store.results import TaskResult
from bayesdamp.types import OK, UNITS, InputError, Unit, level_unit, unit_named
from bayesdamp.verdict.parts import Grade, decay_table, ratios_table
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit, picture_in_unit

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


_CANDIDATES = ["record", "damping", "restoring", "log_evidence", "log_evidence_exact", "rms", "outcome"]
"""Columns of `Comparison.table` if it has no rows; the columns place and parameters are then missing."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Result):
    """The comparison of damping models on one record, or on several records of one specimen (the recorded object).

    Attributes
    ----------
    verdict
        The verdict on the record or the specimen. Its amplitudes are in the file's unit of displacement (rad or m for
        a file in rpm or g), or in the base unit (rad, m) if the files of a specimen have different units. Its
        coefficients stay in base units: rad, m or the sensor's, and s.
    answers
        The answer on each record, in base units: rad, m or the unit of the sensor.
    units
        The name of the unit of each recorded file, such as "deg".
    """

    verdict: Verdict
    answers: tuple[Answer, ...]
    units: tuple[str, ...]

    @cached_property
    def records(self) -> tuple[Comparison, ...]:
        """The comparison on each record by itself, with its own verdict; empty if there is only one record."""
        if len(self.answers) == 1:
            return ()
        return tuple(Comparison(in_unit(a.verdict, unit), (a,), (unit.name,)) for a, unit in self._each())

    @property
    def quantities(self) -> tuple[str, ...]:
        """The quantity of each record: "angle" (any displacement), "velocity", "acceleration" or "envelope"."""
        return tuple(a.verdict.quantity for a in self.answers)

    @property
    def outcome(self) -> str:
        """ "ok", or the reason why no model could be fitted.

        It is also "ok" if the record is not a free decay (see `verdict.grade`), so that no models were compared.
        """
        return self.verdict.sentence if self.verdict.grade is Grade.NOT_WEIGHED else OK

    @property
    def table(self) -> pd.DataFrame:
        """A table with a row for each sum of damping terms and restoring law on each record.

        The columns are:

        - record, damping, restoring: names of the record, the sum of damping terms and the restoring law;
        - log_evidence (with deviations from the laws; NaN if laws were assumed to be exact) and log_evidence_exact
          (under exact laws), each in nats relative to the record's largest value; NaN if the model was not compared;
        - rms: residual under exact laws, in the unit of the recorded values; missing if averages over cycles were
          fitted;
        - outcome: "ok", or why the model was not compared;
        - place: always empty in this table;
        - parameters: names of the inferred damping parameters.

        Rows are sorted by record and falling log_evidence; those without it come last, by falling log_evidence_exact.
        Envelopes, and records on which no model was compared, have no rows. If deviations are inferred, a model that
        could be fitted only under exact laws has none either. Other forms of damping, which may be more probable, are
        in `verdict.rivals`.
        """
        rows = [
            {
                "record": a.verdict.record,
                **asdict(row),
                "rms": None if row.rms is None else row.rms * unit.scale,
            }
            for a, unit in self._each()
            for row in a.content.candidates
        ]
        frame = data_frame(rows, None if rows else _CANDIDATES)
        logs = ["log_evidence", "log_evidence_exact"]
        frame[logs] = frame[logs].astype(float)
        frame[logs] -= frame.groupby("record")[logs].transform("max")
        return frame.sort_values(["record", *logs], ascending=[True, False, False], ignore_index=True)

    @property
    def curve(self) -> pd.DataFrame:
        """The damping against amplitude, measured without assuming a damping law, with 95 % intervals.

        Columns: amplitude (in `unit`); ratio (equivalent damping ratio); lost (energy lost in a cycle per unit of
        inertia, in `unit`²/s²); ratio_low, ratio_high, lost_low and lost_high (ends of the intervals); unit (the file's
        unit of displacement; rad or m for a file in rpm or g); record (its name). There are no rows for an envelope,
        for a record on which no model was compared, and for one that is not suited (for example, too short).
        """
        return self._joined({n: f"free/{n}" for n in DAMPING_CURVES})

    @property
    def law_curve(self) -> pd.DataFrame:
        """The damping ratio against amplitude according to the damping laws, with 95 % intervals.

        It is averaged over the laws, weighted by their probability. Columns: amplitude, ratio (equivalent damping
        ratio; NaN where no motion has the amplitude), ratio_low and ratio_high (ends of the interval), unit (of the
        amplitude, as in `curve`), record. There are no rows for an envelope, for a record on which no model was
        compared, and for one that no law describes (`law_free` of its verdict).
        """
        names = {"amplitude": "amplitude", "ratio": "ratio", "ratio_low": "low", "ratio_high": "high"}
        return self._joined(names)

    def _joined(self, names: Mapping[str, str]) -> pd.DataFrame:
        """Return a table with arrays of all records, in the units of their files, as columns.

        `names` maps the columns to the names of arrays in `Answer.arrays`. Two more columns contain the unit and the
        name of the record. There are no rows for records that lack one of these arrays.
        """
        import pandas as pd

        parts = []
        for a, unit in self._each():
            if all(n in a.arrays for n in names.values()):
                arrays = picture_in_unit(a.arrays, unit)
                columns = pd.DataFrame({column: arrays[n] for column, n in names.items()})
                parts.append(columns.assign(unit=unit.displacement.name, record=a.verdict.record))
        empty = pd.DataFrame(columns=[*names, "unit", "record"])
        return pd.concat(parts, ignore_index=True) if parts else empty

    def _each(self) -> Iterator[tuple[Answer, Unit]]:
        """Yield each record's answer together with the unit of the recorded file."""
        yield from zip(self.answers, map(unit_named, self.units), strict=True)

    def summary(self) -> pd.DataFrame:
        """Return a table of verdicts with the columns of verdicts.csv, without those that no verdict fills.

        It has one row for a single record; otherwise a row for each record, and a last one for the specimen.
        """
        return data_frame([v.row() for v in (*(r.verdict for r in self.records), self.verdict)])

    def plot(self, ax: GivenAxes = None) -> tuple[Axes, ...]:
        """Plot the answer on one record, the first that has an answer: record, damping ratio, residual and energy.

        Parameters
        ----------
        ax
            Four axes, for example from `plt.subplots(2, 2)`; two for an envelope. By default new ones.

        Returns
        -------
        tuple of Axes
            The axes of record, damping ratio against amplitude, residual, and energy by term. For an envelope, the axes
            of record and residual.

        Raises
        ------
        InputError
            If there is nothing to plot (no oscillation has an answer), or `ax` does not contain this number of axes.
        """
        from matplotlib import rc_context

        from bayesdamp.report.drawing import RC, WIDTH
        from bayesdamp.report.figures.answer import ANSWER_HEIGHT, ENVELOPE_HEIGHT, draw_answer, draw_envelope
        from bayesdamp.report.words import divisor

        first = next((i for i, a in enumerate(self.answers) if a.arrays), None)
        if first is None:
            raise InputError(f"nothing to draw: {self.verdict.sentence}")
        answer, unit = self.answers[first], unit_named(self.units[first])
        show_in_notebook()
        with rc_context(RC):
            if answer.content.envelope is not None:
                two = get_axes(ax, 2, columns=2, size=(WIDTH, ENVELOPE_HEIGHT))
                draw_envelope(two, answer.arrays, answer.verdict, level_unit(answer.content.envelope.unit))
                return two
            own, quantity = unit.displacement, answer.verdict.quantity
            recorded = f"{own.quantity_name(quantity)} / {divisor(own.of(quantity))}"
            four = get_axes(ax, 4, columns=2, size=(WIDTH, ANSWER_HEIGHT))
            draw_answer(
                four, picture_in_unit(answer.arrays, unit), own.name, answer.verdict.damping, recorded
            )
        return four

    def report(self, path: str | Path) -> Path:
        """Write a report with the answers on all records as one self-contained HTML file, and return its path.

        Raises InputError if the file cannot be written.
        """
        from bayesdamp.report.results.run import RunFolder
        from bayesdamp.report.sections import page_of

        named = ((f"answer/{a.verdict.record}/0", a) for a in self.answers)
        cells = [TaskResult(name, "comparison", a.content.meta(), a.arrays) for name, a in named]
        judged = ((a.verdict, unit) for a, unit in self._each())
        about = {v.record: {"unit": unit.name, "quantity": v.quantity} for v, unit in judged}
        info = {"name": self.verdict.record, "signals": about, "models": []}
        page, _ = page_of(RunFolder.of_results(info, cells, [self.verdict]))
        return save_bytes(path, page.encode())

    def _table(self) -> Table:
        """Return the table that is printed: damping ratios, or the decay rates of an envelope, against amplitude.

        The caption is the sentence of the verdict, and the notes are its remarks.
        """
        v = self.verdict
        rates, ratios = v.decay_rate, v.damping_ratio
        table = decay_table(rates, v.quality_factor_at) if rates else ratios_table(ratios)
        return replace(table, caption=v.sentence, notes=v.remarks)


def compare(
    signals: types.Signal | EnvelopeRecord | Sequence[types.Signal] | Sequence[EnvelopeRecord],
    *,
    repeats: bool = False,
    name: str = "specimen",
    deviation: str = "auto",
    noise: str | Sequence[str] = "auto",
    damping: str | Sequence[str] = (),
    restoring: str | Sequence[str] = (),
    known: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
    sensor: float = SENSOR,
    amplitudes: Sequence[float] | None = None,
    sample: bool = True,
    seed: int = 0,
) -> Comparison:
    """Find the kind of damping in a record, how large it is, and how well its law holds.

    A comparison on a record of 5,000 samples takes about 5 s, or 1 to 2 s with `sample=False`; longer for records with
    many cycles. The first run of an installation takes 10 to 20 s longer, because the equations of motion are compiled.
    For envelopes (from `read_envelope`), only the options `repeats`, `name`, `damping` and `seed` have an effect;
    each other option must have its default value.

    Parameters
    ----------
    signals
        One record; or, with `repeats`, several records of one specimen (the object that was recorded). The kind of
        damping is assumed to be the same in all records. Its size differs between records by a factor, whose spread is
        inferred.
    repeats
        Whether the records are of one specimen. If False, only one record is allowed.
    name
        Name of the specimen. It has no effect if there is only one record.
    deviation
        "auto" (the default) and "law" have the same effect: the damping and restoring laws may hold approximately, and
        deviations from them are inferred. "none": they hold exactly.
    noise
        A noise model ("gaussian", "student_t", "quantised" or "correlated"); or several, or "auto" for all, from which
        the most probable one is chosen. Gaussian noise, if it is among them, is replaced only by a model whose log
        evidence is clearly larger (at least 5 nats), and never by correlated noise.
    damping, restoring
        Sums of damping terms, such as "viscous+coulomb", and restoring laws to compare. By default these are the seven
        sums of viscous, Coulomb and quadratic damping, and all laws that the unit of the record allows. Other forms of
        damping are tried in addition (not for envelopes).
    known
        Known values of parameters other than damping coefficients, by name, in base units: rad, m or the sensor's unit,
        and s. The stiffness is the squared angular frequency of small oscillations: g/L of a pendulum, k/m of a spring.
    priors
        Priors by name of the damping term or of the parameter, in base units; other parameters have default priors.
    sensor
        Relative linearity error of the sensor (sd; 0.002 by default), which is added in quadrature to the error of
        damping ratios, unless these are measured without a law, or the deviation is "none".
    amplitudes
        Amplitudes at which to give the damping ratio, in the unit of the recorded file (in rad or m if that is a unit
        of velocity or acceleration); by default three in the range of the record. They may be outside each record's
        range by a factor of at most 1.3. For files in different units, they are in the unit of the first file.
    sample
        Whether to sample the most probable models with the full equation of motion. If False, the answer is from linear
        approximations of the motion.
    seed
        Seed of all random numbers.

    Returns
    -------
    Comparison
        The comparison. If no model can be fitted to a record, the `outcome` of the comparison on this record is the
        reason (no Refusal is raised). The verdict on a specimen is from the records that have an answer. If only one
        envelope has a decay, it is the verdict on this record alone; if no record has an answer, on the first record.

    Raises
    ------
    InputError
        If an argument is invalid, an amplitude is too far outside the range of a record, two signals are the same
        record, or the units of the records cannot be converted to each other (envelopes must have the same unit).

    Examples
    --------
    >>> import bayesdamp as bd
    >>> options = {"stiffness": 20.0, "duration": 10.0, "samples": 200, "noise_sd": 0.003}
    >>> signal = bd.simulate({"viscous": 0.05}, "linear", seed=1, **options)
    >>> comparison = bd.compare(signal, damping=["viscous", "coulomb"], restoring=["linear"])
    >>> comparison.verdict.damping
    'viscous'
    >>> first = comparison.verdict.damping_ratio[0]
    >>> first.low < 0.05 / 20.0**0.5 < first.high
    True
    """
    sums = canonical_models(names_given(damping), "compare.damping")
    laws = check_laws(names_given(restoring), "compare.restoring")
    noises = noises_of(check_settings("compare", noise, deviation, sensor))
    terms = tuple(dict.fromkeys(t for sum_ in sums or all_sums() for t in parse_model(sum_, "compare")))
    parameters = [p for law in laws or LAWS.names() for p in Oscillator(terms, law).parameters]
    parameters += [p for name in noises for p in NOISES.get(name).parameters]
    values, given = known_and_priors("compare", known or {}, priors or {}, terms, parameters)
    single = isinstance(signals, types.Signal | EnvelopeRecord)
    every = [signals] if single else list(signals) if isinstance(signals, Iterable) else []
    motions = [s for s in every if isinstance(s, types.Signal)]
    envelopes = [s for s in every if isinstance(s, EnvelopeRecord)]
    one_kind = len(every) in (len(motions), len(envelopes))
    if not every or (len(every) > 1 and not repeats) or not one_kind:
        raise InputError("compare: give one signal, such as read(...).signal(), or several with repeats=True")
    recorded = [s.y for s in motions] or [r.level for r in envelopes]
    if any(np.array_equal(a, b) for a, b in combinations(recorded, 2)):
        raise InputError("compare: two of the signals are the same record; give each record once")
    if envelopes:
        for option, is_given in {
            "noise": noise != "auto",
            "deviation": deviation != "auto",
            "amplitudes": amplitudes is not None,
            "restoring": bool(restoring),
            "known": bool(known),
            "priors": bool(priors),
            "sensor": sensor != SENSOR,
            "sample": not sample,
        }.items():
            if is_given:
                raise InputError(f"compare: {option} does not apply to envelopes; remove it")
        units = tuple(r.unit for r in envelopes)
        compared_sums = [parse_model(sum_) for sum_ in sums or all_sums()]
        answers = tuple(answer_envelope(r, None, compared_sums, seed, len(every) > 1) for r in envelopes)
        together = specimen_of_envelopes(name, answers) if len(every) > 1 else None
    else:
        units = tuple(Signal.of(s).own_unit.name for s in motions)
        bases = dict.fromkeys(UNITS[unit].base for unit in units)
        for option, is_given in {"amplitudes": amplitudes is not None, "repeats": repeats}.items():
            if is_given and len(bases) > 1:
                what = f"compare: {option}: the records are in {' and '.join(bases)}"
                raise InputError(f"{what}; leave out {option}, or give records in one unit")
        compared = partial(compare_models, deviation=deviation, noise=noise, damping=sums, restoring=laws)
        answered = partial(answer, unit=UNITS[units[0]], sensor=sensor, sample=sample, seed=seed)
        answers = tuple(
            answered(s, compared(s, known=values, priors=given), amplitudes, repeated=len(every) > 1)
            for s in motions
        )
        good = [a.of_specimen() for a in answers if a.arrays]
        scale = UNITS[units[0]].displacement.factor
        wanted = None if amplitudes is None else [float(a) * scale for a in amplitudes]
        together = specimen(name, good, given, sensor, seed, wanted) if good and len(every) > 1 else None
    verdict = together or next((a.verdict for a in answers if a.verdict.damping), answers[0].verdict)
    own = [unit_named(unit) for unit in units]
    if len({unit.displacement.name for unit in own}) == 1:
        verdict = in_unit(verdict, own[0])
    return Comparison(verdict, answers, units)
