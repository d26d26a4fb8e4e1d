"""The dictionary of columns: what stands in each column of each table that a run writes, and in which unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

SCHEMA = 1
"""Version of the tables, written in run.json: it goes up when a column is renamed, removed, or means something else."""


@dataclass(frozen=True)
class Column:
    """unit: in words where it differs from row to row; empty for text and counts."""

    name: str
    unit: str
    meaning: str


_ROW = "of the row's `unit`"
_SUMMARY = {
    "mean": (_ROW, "mean of the draws"),
    "sd": (_ROW, "their standard deviation"),
    "median": (_ROW, "their median"),
    "q2.5": (_ROW, "quantile at 2.5 %: lower end of the 95 % interval"),
    "q25": (_ROW, "quantile at 25 %"),
    "q75": (_ROW, "quantile at 75 %"),
    "q97.5": (_ROW, "quantile at 97.5 %: upper end of the 95 % interval"),
}
_LIKELIHOOD = (
    "",
    "the likelihood: `law`, in which laws may hold approximately, or `none`, in which they hold exactly",
)
_COMMON = {
    "signal": ("", "name of the signal in the study"),
    "repeat": ("", "which repeat of a simulated signal, from 0"),
    "model": ("", "damping sum, such as `viscous+coulomb`"),
    "restoring": ("", "restoring law"),
    "parameter": ("", "name of the parameter"),
    "unit": ("", "its unit"),
    "seconds": ("s", "time of the computation"),
    "outcome": ("", "`ok`, or a sentence why there is no number, or what to know of it"),
    "record": ("", "name of the record"),
    **_SUMMARY,
}
_TABLES: dict[str, dict[str, tuple[str, str]]] = {
    "estimates.csv": {
        "estimator": ("", "method, or the study's own name for a variant"),
        "stage": (
            "",
            "`initial`, the method's own estimate, or `refined`, the trajectory fit that starts there",
        ),
        "value": (_ROW, "the estimate"),
        "stderr": (_ROW, "its standard error, where the method gives one"),
        "truth": (_ROW, "the value that the record was simulated with"),
        "error_pct": ("%", "|value − truth| / |truth|"),
        "evaluations": ("", "evaluations of the method's objective"),
    },
    "posteriors.csv": {
        "sampler": ("", "how the posterior was drawn from"),
        "deviation": _LIKELIHOOD,
        "sd_noise": (
            _ROW,
            "part of the sd that noise alone would leave, were the laws exact (where `deviation` is `law`)",
        ),
        "sd_law": (_ROW, "part of the sd from how far the laws hold (where `deviation` is `law`)"),
        "hdi_low": (_ROW, "lower end of the shortest 95 % interval"),
        "hdi_high": (_ROW, "upper end of the shortest 95 % interval"),
        "ess_bulk": ("", "effective draws for the mean"),
        "ess_tail": ("", "effective draws for the tails"),
        "rhat": ("", "convergence of the chains, 1 where they agree"),
        "divergences": ("", "steps at which the integrator of the Hamiltonian failed"),
    },
    "evidence.csv": {
        "method": ("", "how the evidence was computed; `combined` is what counts"),
        "deviation": _LIKELIHOOD,
        "log_evidence": ("nat", "log probability of the record under the model"),
        "stderr": ("nat", "standard error of the computation"),
        "log_bayes_factor": ("nat", "log evidence less that of the best model; 0 for the best"),
        "probability": (
            "",
            "of the model among those compared, each further term a quarter as probable beforehand",
        ),
        "diagnostic": ("", "how far the computation is to be trusted"),
    },
    "fits.csv": {
        "rms": ("of the row's `rms_unit`", "root mean square of the residuals of the best fit"),
        "rms_unit": ("", "unit of what was recorded"),
        "residual_autocorrelation": ("", "of neighbouring residuals: 0 where they are white"),
        "window_spread": (
            "standard deviations",
            "how far a coefficient moves when half of the record is used",
        ),
        "predictive_p": (
            "",
            "posterior predictive p of the structure in the whitened residuals: small where some is left",
        ),
        "deviation": ("", "energy-weighted mean of the relative deviation from the damping law: median"),
        "deviation_low": ("", "lower end of its 95 % interval"),
        "deviation_high": ("", "upper end of its 95 % interval"),
        "unexplained_pct": (
            "% of the amplitude",
            "root mean square of what the plain fit leaves beyond noise",
        ),
        "verdict": ("", "what the residuals say of the fit"),
    },
    "verdicts.csv": {
        "grade": (
            "",
            "how a law describes the record: `exact`, `approximate`, `deviates`, `no_free_decay`, `not_weighed`",
        ),
        "decided": ("", "whether one damping is named without reservation"),
        "damping": ("", "the likeliest damping sum"),
        "probability": ("", "its probability among those that were weighed"),
        "unexplained_pct": ("% of the amplitude", "root mean square of what neither law nor noise explains"),
        "noise_pct": ("% of the amplitude", "root mean square of the noise"),
        "start": ("s of the file's times", "where the free decay begins"),
        "stop": ("s of the file's times", "where it ends"),
        "sentence": ("", "the answer in words"),
        "exponent": ("", "power of the velocity that the damping force goes with, were it a single power"),
        "deviation": (
            "",
            "energy-weighted mean of the relative deviation of the force from the law, over the record",
        ),
        "rivals": ("", "other sums with their probabilities, as `sum:probability`"),
        "restoring": ("", "the likeliest restoring law"),
        "restoring_probability": ("", "its probability"),
        "frequency": (
            "Hz",
            "natural frequency of small oscillations, by the restoring law; of an envelope, the given one",
        ),
        "frequency_at": ("Hz", "frequency at the last amplitude that a ratio is given at"),
        "midline_drift_pct": (
            "% of the first amplitude",
            "by how much the midline moves over the record; 0 where that is not seen",
        ),
        "amplitude_#": (_ROW.replace("unit", "unit_#"), "where the damping ratio is given"),
        "unit_#": ("", "its unit: that which the record came in"),
        "ratio_#": ("", "equivalent viscous damping ratio there"),
        "ratio_#_sd_noise": ("", "standard deviation of it from noise"),
        "ratio_#_sd_law": ("", "standard deviation of it from what the law does not hold"),
        "ratio_#_next_low": (
            "",
            "of several records: lower end of the 95 % interval of what one more would have",
        ),
        "ratio_#_next_high": ("", "upper end of it"),
        "quantity": (
            "",
            "what the record holds of the motion: `angle` (or displacement), `velocity`, `acceleration`, `envelope`",
        ),
        "rate": ("1/s", "of an envelope: decay rate of the amplitude, mean over the first half of the fall"),
        "quality_factor": ("", "of an envelope: Q, where the frequency is known"),
        "#_sd_noise": ("of #", "standard deviation from noise"),
        "#_sd_law": ("of #", "standard deviation from what the law does not hold"),
        "viscous": ("", "probability that the term is there"),
        "coulomb": ("", "probability that the term is there"),
        "quadratic": ("", "probability that the term is there"),
        "power_law": (
            "nat",
            "of an envelope: log Bayes factor of one power of the amplitude against the sums",
        ),
        "probability_exact": ("", "of an envelope: probability that the law holds exactly"),
        "spread": ("", "of several records: relative standard deviation of the damping between them"),
        "spread_low": ("", "lower end of its 95 % interval"),
        "spread_high": ("", "upper end of its 95 % interval"),
        "unnamed": ("", "share of the energy lost that no sum of the terms explains"),
        "energy": ("", "share of the energy lost by each term, as `term:share(low,high)`"),
        "other_forms": ("", "share of it that an absent form takes at most (95 %), as `form:share`"),
        "cycles": ("", "cycles of the free decay"),
        "remarks": ("", "what else to know"),
    },
    "damping_curves.csv": {
        "unit": ("", "unit of the amplitude: that which the record came in"),
        "amplitude": (_ROW, "amplitude of the oscillation"),
        "ratio": ("", "equivalent viscous damping ratio there, without a law of damping"),
        "lost": ("square of the row's `unit` per s²", "energy lost in a cycle, per unit of inertia"),
    },
    "specimens.csv": {
        "specimen": ("", "name of the specimen"),
        "records": ("", "how many records of it were joined"),
        "record": ("", "the record alone; empty for the joint fit"),
        "shared": ("", "what the records share"),
        "log_evidence": (
            "nat",
            "of the joint fit, or of the record alone, relative to the best model of each record by itself",
        ),
        "probability": ("", "of the damping sum and restoring law, as in the answer on the specimen"),
    },
    "population.csv": {
        "over": ("", "what the population is of: `specimens`, or `repeats of NAME`"),
        "what": (
            "",
            "`mean` or `spread` of the population, or a member's `own value`; of repeats the specimen's coefficient, "
            "its standard deviation from record to record, and that of each record alone",
        ),
        "of": ("", "which member"),
        "effective": ("", "effective draws"),
        "prior_scale": (_ROW, "scale of the half-normal prior of the mean; empty for repeats"),
    },
    "calibration.csv": {
        "method": ("", "sampler, or `refined estimate`, the trajectory fit"),
        "check": ("", "`ranks` or `coverage`"),
        "level": ("", "nominal coverage of the interval"),
        "records": ("", "records that count"),
        "without": ("", "records that have no interval"),
        "value": (
            "",
            "of ranks, the largest departure from uniform; of coverage, the share that holds the truth",
        ),
        "low": ("", "lower end of what 99 % of such shares are between"),
        "high": ("", "upper end of it"),
        "p": ("", "probability of so large a departure by chance"),
        "p_holm": ("", "the same, for all checks of the table together (Holm)"),
        "verdict": ("", "`passes`, `wrong`, or `not tested`"),
    },
    "ranks.csv": {
        "sampler": ("", "how the posterior was drawn from"),
        "ranks": ("", "rank of the truth among the draws, record by record"),
    },
    "recovery.csv": {
        "series": ("", "which series of records"),
        "record": ("", "number of the record, from 0"),
        "noise": ("of the amplitude", "standard deviation of the noise"),
        "cycles": ("", "cycles in the record"),
        "loss": ("", "share of the amplitude that is lost"),
        "model": ("", "the damping sum that made the record"),
        "doubts": ("", "sums whose evidence came with a sentence instead of `ok`"),
        "SUM": ("", "a column for each damping sum: its probability"),
    },
}
ENDS = {"_low": "lower end of the 95 % interval of", "_high": "upper end of the 95 % interval of"}


def described(table: str, columns: Sequence[str]) -> list[Column]:
    """The columns of a table in its order. Raises KeyError for one that is not in the dictionary."""
    own = _COMMON | _TABLES[table]
    return [_described(own, name) for name in columns]


def unused(table: str, columns: Sequence[str]) -> set[str]:
    """Entries of a table's own dictionary that describe none of its columns."""
    own = _COMMON | _TABLES[table]
    return set(_TABLES[table]) - {_entry(own, name) for name in columns} - {"SUM"}


def _entry(own: dict[str, tuple[str, str]], name: str) -> str:
    """The entry that describes a column. Raises KeyError."""
    numbered = re.sub(r"_\d+", "_#", name)
    for end in ("", *ENDS):
        stem = numbered.removesuffix(end)
        if (not end or stem != numbered) and stem in own:
            return stem
    for end in ("_sd_noise", "_sd_law"):
        if name.endswith(end) and f"#{end}" in own:
            return f"#{end}"
    if "+" in name or name in ("viscous", "coulomb", "quadratic"):
        return "SUM" if "SUM" in own else _missing(name)
    return _missing(name)


def _missing(name: str) -> str:
    raise KeyError(name)


def _described(own: dict[str, tuple[str, str]], name: str) -> Column:
    entry = _entry(own, name)
    unit, meaning = own[entry]
    end = next((e for e in ENDS if name.endswith(e) and not entry.endswith(e)), "")
    if end:
        meaning = f"{ENDS[end]} `{name.removesuffix(end)}`"
    if entry.startswith("#"):
        unit, meaning = unit.replace("#", f"`{name.removesuffix(entry[1:])}`"), meaning
    return Column(name, unit, meaning)
