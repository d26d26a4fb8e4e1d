"""Read what the sections of a report show from the folder of a run: tables, verdicts, ranked models, true values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from markupsafe import Markup

from bayesdamp import formatting as fmt
from bayesdamp.priors import FURTHER_TERM
from bayesdamp.report import words
from bayesdamp.store.files import POPULATION, SCHEMA, TABLES, read_description, read_table
from bayesdamp.store.results import AnswerContent, Store, TaskName, TaskResult
from bayesdamp.types import (
    OK,
    InputError,
    Provenance,
    Status,
    Unit,
    candidate_name,
    candidate_parts,
    reason_of,
    status_of,
    sum_probabilities,
    unit_named,
)
from bayesdamp.verdict.parts import number
from bayesdamp.verdict.types import VERDICT_JSON, Verdict, load_verdicts
from bayesdamp.verdict.units import in_unit, picture_in_unit
from bayesdamp.verdict.words import deviation_limit

if TYPE_CHECKING:
    from bayesdamp.report.drawing import Drawings

Row = dict[str, Any]
"""A row of a table of the run, by column; or a part of run.json."""
_METHODS_BY_TRUST = ("combined", "nested", "bridge", "importance", "laplace")
"""Evidence methods, the most trusted first."""
_SHIPPED = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
"""Name of the damping coefficient, by name of the damping term, for the three classical terms."""
ANCHOR = "answer-"
"""Prefix of the HTML anchor (the target of a link) of a record's answer in the page; the record's name follows it."""
MOST_RESULTS = 100
"""Largest number of task results that are cached in memory. A small number suffices, because each section reads one
record after the other; a run may have thousands of results."""
CURVE = ("amplitude", "ratio", "low", "high")
"""Names of the arrays of an answer that make its damping curve: amplitude, damping ratio, and the ends of the 95 %
interval of the ratio."""
Curve = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""A damping curve: amplitudes, damping ratios (fractions), and the low and the high ends of their 95 % intervals, each
(points,)."""


@dataclass(frozen=True)
class StoredAnswer:
    """The answer on a record, for the report.

    Attributes
    ----------
    signal
        Name of the record.
    verdict
        The verdict on the record. Its amplitudes, also those in its sentence, are in the unit of the record's file;
        coefficients stay in rad or m, and s.
    content
        The stored answer: compared models, noise models, and values of an envelope; in base units.
    arrays
        Arrays of the answer, such as those of its figure, by name, converted to the unit of the record's file
        (`picture_in_unit`).
    """

    signal: str
    verdict: Verdict
    content: AnswerContent
    arrays: Mapping[str, np.ndarray]


class RunFolder:
    """The contents of a run's folder. Everything except run.json may be missing.

    Attributes
    ----------
    folder
        The folder.
    info
        The contents of run.json.
    verdicts
        Verdicts on records, and on specimens (tested objects with several records), in base units such as rad.
    estimates, posteriors, evidence, fits
        Rows of the tables. The column `model` contains the damping sum, and also the restoring law if the signal is
        compared under several restoring laws.
    population
        Rows of population.csv (damping coefficients over several specimens); empty if the run has no such file.

    Raises
    ------
    InputError
        If the folder does not contain a run, another version of bayesdamp wrote it, or a table or verdict.json is
        damaged.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.info = read_description(self.folder)
        if "kind" in self.info and self.info.get("schema") != SCHEMA:
            what = "was written by another version of bayesdamp; run the calibration again"
            raise InputError(f"{self.folder / 'run.json'}: {what}")
        tables: list[list[Row]] = []
        for name, columns in {**TABLES, "population.csv": POPULATION}.items():
            path = self.folder / name
            rows = read_table(path) if path.is_file() else []
            missing = set(columns) - set(rows[0]) if rows else set()
            if missing:
                raise InputError(
                    f"{path}: column {', '.join(sorted(missing))} is missing; this file was changed, or not written by "
                    "this version; run the study again"
                )
            for row in rows:
                if len(self.about(row.get("signal", "")).get("restoring") or ()) > 1:
                    row["model"] = candidate_name(row["model"], row["restoring"])
            tables.append(rows)
        self.estimates, self.posteriors, self.evidence, self.fits, self.population = tables
        self._figures: Path | None = self.folder / "figures"
        self._store = Store(self.folder, self.info.get("cells"))
        self._places = {name: TaskName.of(name) for name in self._store.names()}
        path = self.folder / VERDICT_JSON
        try:
            self.verdicts = load_verdicts(path) if path.is_file() else []
        except (OSError, AttributeError, KeyError, TypeError, ValueError):
            raise InputError(f"{path}: this file is damaged; run the study again") from None

    @classmethod
    def of_results(
        cls, info: Row, task_results: Sequence[TaskResult], verdicts: Sequence[Verdict] = ()
    ) -> Self:
        """Return a run without a folder, from the contents of run.json (`info`), task results and verdicts in memory.

        Its tables are empty, and its figures are not saved as files.
        """
        run = cls.__new__(cls)
        run.info, run.verdicts, run._figures = info, list(verdicts), None
        run.estimates, run.posteriors, run.evidence, run.fits, run.population = [], [], [], [], []
        by_name = {task_result.name: task_result for task_result in task_results}
        run._find, run._places = by_name.get, {name: TaskName.of(name) for name in by_name}
        return run

    @cached_property
    def drawings(self) -> Drawings:
        """The object that draws figures and saves them in the folder `figures`."""
        from bayesdamp.report.drawing import Drawings  # imports Matplotlib, which the terminal does not need

        return Drawings(self._figures)

    @cached_property
    def parts(self) -> dict[tuple[str, str], Markup]:
        """Parts of the report that other processes have made, by the names of the section and of the signal."""
        return {}

    @property
    def study(self) -> Row:
        """The study with all its settings; empty if run.json does not contain it."""
        return self.info.get("study") or {}

    @property
    def under_law(self) -> bool:
        """Whether the study's samplers and evidence methods allow deviations from the damping and restoring laws."""
        return (self.study.get("posterior") or {}).get("deviation") == "law"

    @cached_property
    def signals(self) -> list[str]:
        """Names of the signals, in the study's order."""
        rows = (row["signal"] for row in self._rows)
        task_results = (place.record for place in self._places.values() if place.kind == "signal")
        return list(dict.fromkeys([*(self.info.get("signals") or {}), *rows, *task_results]))

    @cached_property
    def models(self) -> list[str]:
        """Names of the damping models in run.json and in the tables, in the study's order."""
        return list(dict.fromkeys([*(self.info.get("models") or []), *(row["model"] for row in self._rows)]))

    @property
    def _rows(self) -> list[Row]:
        return [*self.estimates, *self.posteriors, *self.evidence, *self.fits]

    def about(self, signal: str) -> Row:
        """Return the description of a signal in run.json (unit, quantity, simulated, ...); {} if there is none."""
        return (self.info.get("signals") or {}).get(signal) or {}

    def unit(self, signal: str) -> Unit:
        """Return the unit of a signal's displacement, or of its values (rpm, g); rad if run.json states none."""
        return unit_named(self.about(signal).get("unit") or "rad")

    def quantity(self, signal: str) -> str:
        """Return the recorded quantity: "angle" (also if not stated), "velocity", "acceleration" or "envelope"."""
        return str(self.about(signal).get("quantity") or "angle")

    def provenance(self, signal: str) -> Provenance:
        """Return how a signal's record was read and cleaned, with warnings; empty if run.json does not contain it."""
        return Provenance.of(self.about(signal))

    def is_simulated(self, signal: str) -> bool:
        """Return whether the program simulated the signal, so that its true parameters are known."""
        return bool(self.about(signal).get("simulated"))

    def simulation(self, signal: str) -> Row:
        """Return the study's settings of a simulated signal (damping, true values, ...); {} for a measured one."""
        source = self._studied.get(signal, {}).get("source") or {}
        return source if "damping" in source else {}

    @cached_property
    def _studied(self) -> dict[str, Row]:
        """The study's settings of each signal, by its name."""
        return {s["name"]: s for s in self.study.get("signals") or [] if isinstance(s, dict)}

    def repeats(self, signal: str) -> list[int]:
        """Return the numbers of a signal's repeats, from 0; [0] if no result is stored."""
        return sorted(self._repeats.get(signal, ())) or [0]

    @cached_property
    def _repeats(self) -> dict[str, set[int]]:
        """The repeats (numbered from 0) of each signal that have rows in a table or stored results."""
        pairs = [(row["signal"], row["repeat"]) for row in self._rows]
        pairs += [(place.record, place.repeat) for place in self._places.values()]
        repeats: dict[str, set[int]] = {}
        for signal, repeat in pairs:
            if repeat is not None:
                repeats.setdefault(signal, set()).add(repeat)
        return repeats

    def task_result(self, *parts: object) -> TaskResult | None:
        """Return the stored result of the task whose name consists of these parts, joined by /.

        The parts are the kind of the task, the record, the repeat (from 0), and for some kinds the model and a method:
        `task_result("mode", "run-1", 0, "viscous")`. None if there is no such result, or if it is damaged.
        """
        return self._find("/".join(map(str, parts)))

    @cached_property
    def _find(self) -> Callable[[str], TaskResult | None]:
        """The function that reads a stored result by its name, with a cache of `MOST_RESULTS` results."""
        return lru_cache(MOST_RESULTS)(self._store.find)

    def task_results(self, *parts: object) -> Iterator[TaskResult]:
        """Yield the undamaged results of all tasks whose names begin with these parts, and have more parts after them.

        Without parts, yield those of all tasks. The parts are as for `task_result`.
        """
        prefix = "".join(f"{part}/" for part in parts)
        names = self._names.get(parts[:2], ()) if len(parts) > 1 else self._places
        results = (self.task_result(name) for name in names if name.startswith(prefix))
        return filter(None, results)

    @cached_property
    def _names(self) -> dict[tuple[object, ...], list[str]]:
        """The names of all stored results, by the kind of the task and the record."""
        names: dict[tuple[object, ...], list[str]] = {}
        for name, place in self._places.items():
            names.setdefault((place.kind, place.record), []).append(name)
        return names

    @cached_property
    def only_answered(self) -> bool:
        """Whether the run contains answers on records, but no fits of single models (tasks of the kind `mode`)."""
        answered = any(answer_of(self, signal) for signal in self.signals)
        return answered and not any(self.task_results("mode", signal) for signal in self.signals)


def rows_of(rows: Iterable[Row], **wanted: object) -> list[Row]:
    """Return the rows in which each of the named columns equals the given value, in their order."""
    return [row for row in rows if all(row[column] == value for column, value in wanted.items())]


@dataclass(frozen=True)
class EvidenceRanking:
    """The models of one repeat of a signal, ranked by their evidence.

    Attributes
    ----------
    method
        The evidence method of the ranking.
    rows
        Rows of evidence.csv by this method, the most probable model first; rows without a probability are left out.
    shares
        For every evidence method that gave probabilities, the probability of each sum of damping terms, summed over the
        restoring laws.
    """

    method: str
    rows: list[Row]
    shares: dict[str, dict[str, float]]

    @property
    def dampings(self) -> dict[str, float]:
        """The probability of each sum of damping terms by the method of the ranking, the most probable first."""
        return self.shares[self.method]


def damping_of(row: Row) -> str:
    """Return the damping sum (such as viscous+coulomb) of a row's model, without the restoring law."""
    return candidate_parts(row["model"])[0]


def rank_models(run: RunFolder, signal: str, repeat: int) -> EvidenceRanking | None:
    """Rank the models by the evidence method that has finite probabilities for the largest number of models.

    If several methods have them for the same number of models, the first of this list is used: combined evidence,
    nested sampling, bridge sampling, importance sampling, Laplace, any other. Returns None if no method has a finite
    probability.
    """
    by_method: dict[str, list[Row]] = {}
    for row in rows_of(run.evidence, signal=signal, repeat=repeat):
        if np.isfinite(row["probability"]):
            by_method.setdefault(row["method"], []).append(row)
    if not by_method:
        return None

    def trust(name: str) -> tuple[int, int, str]:
        place = _METHODS_BY_TRUST.index(name) if name in _METHODS_BY_TRUST else len(_METHODS_BY_TRUST)
        return -len(by_method[name]), place, name

    def rank(row: Row) -> tuple[float, float]:
        return -row["probability"], -np.nan_to_num(row["log_evidence"], nan=-1e300)

    chosen = min(by_method, key=trust)
    every = {name: {r["model"]: r["probability"] for r in rows} for name, rows in by_method.items()}
    shares = {name: sum_probabilities(probabilities) for name, probabilities in every.items()}
    return EvidenceRanking(chosen, sorted(by_method[chosen], key=rank), shares)


def probabilities_by_odds(ranked: EvidenceRanking) -> dict[float, dict[str, float]]:
    """Return how the probabilities of the sums of damping terms depend on the prior odds of a further term.

    The prior probability of a sum contains a factor for each term after the first. The result maps half, once and twice
    the standard value of this factor to the probability of each sum with it. It is empty if all sums have the same
    number of terms.
    """
    counts = {damping_of(row): damping_of(row).count("+") for row in ranked.rows}
    if len(set(counts.values())) < 2:
        return {}
    shares = {}
    for factor in (0.5 * FURTHER_TERM, FURTHER_TERM, 2 * FURTHER_TERM):
        weights = {d: p * (factor / FURTHER_TERM) ** counts[d] for d, p in ranked.dampings.items()}
        shares[factor] = {d: weight / sum(weights.values()) for d, weight in weights.items()}
    return shares


def models_by_rank(run: RunFolder, signal: str, repeat: int) -> list[str]:
    """Return the names of all models of a signal: first the ranked ones, the most probable first, then the others.

    The others are in the study's order. A name is the damping sum, with "@" and the restoring law added if the signal
    is compared under several restoring laws.
    """
    ranked = rank_models(run, signal, repeat)
    rows = (*run.estimates, *run.posteriors, *run.evidence, *run.fits)
    models = {r["model"] for r in rows if r["signal"] == signal}
    models |= {task_result.parts.candidate for task_result in run.task_results("mode", signal, repeat)}
    first = [row["model"] for row in ranked.rows] if ranked else []
    return list(dict.fromkeys([*first, *(m for m in run.models if m in models), *sorted(models)]))


def models_not_pruned(run: RunFolder, signal: str, repeat: int) -> list[str]:
    """Return the names of the models that were not left out as far too improbable (pruned), as in `models_by_rank`."""
    ranked = rank_models(run, signal, repeat)
    pruned = {r["model"] for r in (ranked.rows if ranked else []) if status_of(r["outcome"]) is Status.PRUNED}
    return [model for model in models_by_rank(run, signal, repeat) if model not in pruned]


def summary_rows(run: RunFolder, signal: str, repeat: int, model: str) -> list[Row]:
    """Return the rows of posteriors.csv for one model on a record, from the preferred sampler.

    A sampler whose outcomes are all `ok` is preferred. If there are several, or none, NUTS is preferred, and then the
    first sampler. Rows without a finite mean are left out.
    """
    rows = rows_of(run.posteriors, signal=signal, repeat=repeat, model=model)
    by_sampler = [rows_of(rows, sampler=s) for s in dict.fromkeys(row["sampler"] for row in rows)]

    def doubted(own: list[Row]) -> bool:
        return any(r["outcome"] != OK for r in own) or not any(np.isfinite(r["mean"]) for r in own)

    best = min(by_sampler, key=lambda own: (doubted(own), own[0]["sampler"] != "nuts"), default=[])
    return [r for r in best if np.isfinite(r["mean"])]


def truth(run: RunFolder, signal: str, parameter: str) -> float:
    """Return the true value of a simulated signal's parameter, in its unit in the tables; nan if it is not known."""
    if not run.is_simulated(signal):
        return np.nan
    for row in run.estimates:
        if row["signal"] == signal and row["parameter"] == parameter and np.isfinite(row["truth"]):
            return row["truth"]
    simulated = run.simulation(signal).get("truth") or {}
    return float(simulated.get(parameter, np.nan))


def damping_parameters(run: RunFolder) -> dict[str, str]:
    """Return the name of each damping term's coefficient, such as "zeta", by name of the term, such as "viscous".

    The result contains the three classical terms and the terms that run.json describes.
    """
    added = run.info.get("damping") or {}
    return {**_SHIPPED, **{term: about["parameter"] for term, about in added.items()}}


def coefficients(run: RunFolder, model: str) -> list[str]:
    """Return the names of the damping coefficients of a model, such as "zeta", in the order of its terms.

    Terms that `damping_parameters` does not contain are left out.
    """
    parameters = damping_parameters(run)
    return [parameters[term] for term in candidate_parts(model)[0].split("+") if term in parameters]


def answer_of(
    run: RunFolder, signal: str, kinds: tuple[str, ...] = ("sampled", "answer")
) -> StoredAnswer | None:
    """Return the answer (the comparison of damping models) on the first repeat of a record.

    None if there is none with the outcome `ok`. `kinds` lists the kinds of tasks whose answer is accepted, the
    preferred kind first: "sampled" (from sampling) and "answer" (from linear approximations).
    """
    return next((a for kind in kinds if (a := _answer(run, signal, kind)) is not None), None)


@lru_cache(3)  # each section reads one record after the other
def _answer(run: RunFolder, signal: str, kind: str) -> StoredAnswer | None:
    """Return the answer on the first repeat of a record by one kind of task; None unless its outcome is `ok`."""
    task_result = run.task_result(kind, signal, run.repeats(signal)[0])
    if task_result is None or task_result.outcome != OK:
        return None
    unit, content = run.unit(signal), AnswerContent.of(task_result)
    verdict = in_unit(Verdict.from_dict(content.verdict), unit)
    return StoredAnswer(signal, verdict, content, picture_in_unit(task_result.arrays, unit))


def no_verdict_sentence(run: RunFolder, signal: str) -> str:
    """Return a sentence that says why a record has no verdict.

    If there is only one model and nothing failed, the sentence says that this model was assumed.
    """
    repeat = run.repeats(signal)[0]
    task_result, models = run.task_result("answer", signal, repeat), models_by_rank(run, signal, repeat)
    outcomes = (str(run.about(signal).get("outcome", OK)), OK if task_result is None else task_result.outcome)
    failed = next((outcome for outcome in outcomes if outcome != OK), None)
    if failed is not None:
        why = reason_of(failed).rstrip(".")
    elif len(models) == 1:
        return f"Damping was assumed to be {words.model(models[0])}; no other model was compared."
    elif not models:
        why = "nothing was computed for this signal"
    else:
        why = "it was not computed" if rank_models(run, signal, repeat) else "no evidence was computed"
    return f"No verdict on the damping: {why}."


@lru_cache(1)
def answers(run: RunFolder) -> list[StoredAnswer]:
    """Return the answers (comparisons of damping models) on the first repeats of all records, in the study's order.

    To save memory, their `arrays` contain only the damping curve (`CURVE`), and their `content` is empty.
    """
    every = filter(None, (answer_of(run, signal) for signal in run.signals))
    curves = ((a, {n: a.arrays[n] for n in CURVE if n in a.arrays}) for a in every)
    return [replace(a, content=AnswerContent({}), arrays=curve) for a, curve in curves]


def specimens(run: RunFolder) -> list[Verdict]:
    """Return the verdict on each specimen, which is a tested object with several records.

    Amplitudes are in the unit of the records' files if all signals of the run have the same unit, otherwise in base
    units such as rad. Coefficients are always in rad or m, and s.
    """
    verdicts = [v for v in run.verdicts if v.record not in run.signals]
    units = {run.unit(signal) for signal in run.signals}
    return [in_unit(v, next(iter(units))) for v in verdicts] if len(units) == 1 else verdicts


def curve_of(answer: StoredAnswer) -> Curve | None:
    """Return the points of an answer's damping curve that are finite and have a positive amplitude.

    Amplitudes are in the unit of the record's file, ratios are fractions. None if there are fewer than two points, if
    the verdict has no damping ratio, or if its ratios were measured without a damping law.
    """
    if not answer.verdict.damping_ratio or not set(CURVE) <= set(answer.arrays):
        return None
    columns = np.array([answer.arrays[name] for name in CURVE], float)
    columns = columns[:, np.isfinite(columns).all(axis=0) & (columns[0] > 0)]
    return (columns[0], columns[1], columns[2], columns[3]) if columns.shape[1] > 1 else None


def overview_table(records: Sequence[StoredAnswer], brief: bool = False) -> fmt.Table:
    """Return a table with a row for each record: its damping, probability, frequency and damping ratio.

    The damping ratio is at the middle one of the amplitudes of the record's verdict. Instead of it, an envelope has its
    quality factor Q (its decay rate if no envelope has a Q) and the power of the velocity.

    Parameters
    ----------
    records
        The answers on the records.
    brief
        Whether to leave out the links to the records' answers and the columns on how well the law holds (for the
        terminal).

    Returns
    -------
    Table
        The table, with the records in the given order.
    """
    envelopes = [a for a in records if a.verdict.quantity == "envelope"]
    quality = any(a.verdict.quality_factor for a in envelopes)

    def name(a: StoredAnswer) -> str:
        return a.signal if brief else Markup('<a href="#{}">{}</a>').format(ANCHOR + a.signal, a.signal)

    def damping(a: StoredAnswer) -> str:
        motion = f": {a.verdict.motion}" if a.verdict.motion else ""
        return words.model(a.verdict.damping) if a.verdict.damping else f"not a free decay{motion}"

    def size(a: StoredAnswer) -> str:
        if not a.verdict.damping_ratio:
            return fmt.NONE
        ratio = a.verdict.damping_ratio[len(a.verdict.damping_ratio) // 2]
        size = fmt.with_interval(ratio.value, ratio.low, ratio.high, " %", 100)
        return f"{size}, {fmt.digits(ratio.amplitude, n=2)} {ratio.unit}"

    columns: dict[str, Callable[[StoredAnswer], str]] = {
        "record": name,
        "damping": damping,
        "probability": lambda a: fmt.probability(a.verdict.probability),
        "frequency / Hz": lambda a: fmt.number(a.verdict.frequency and a.verdict.frequency.value, 4),
    }
    if len(envelopes) < len(records):
        columns["damping ratio (95 %), amplitude"] = size
    if envelopes:
        columns["Q (95 %)" if quality else "rate / (1/s) (95 %)"] = lambda a: number(
            a.verdict.quality_factor if quality else a.verdict.rate
        )
        columns["power of the velocity (95 %)"] = lambda a: number(a.verdict.exponent)
    if not brief:
        columns["deviation from the law below / %"] = lambda a: (
            deviation_limit(a.verdict.deviation) if a.verdict.deviation else fmt.NONE
        )
        columns["unexplained / %"] = lambda a: fmt.number(a.verdict.unexplained_pct, 2)
    return fmt.Table.of(records, columns, (0, 1), kind=lambda a: "" if a.verdict.decided else "quiet")


def rms_of(row: Row) -> str:
    """Return the root mean square residual in a row of fits.csv as text, with its unit."""
    return f"{fmt.number(row['rms'], 3)} {row['rms_unit']}"
