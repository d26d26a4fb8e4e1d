"""The stored numbers that the cells and sentences of the page and of the terminal must show."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bayesdamp.report import words
from tests.report.conftest import CANDIDATES, METHODS, OF_SPECIMENS, OWN, SHARED
from tests.report.pages import Stored

UNIT = {"bench": 180 / math.pi, "sim": 1.0, "sim-2": 1.0}
COUNTS = {"bench": 1, "sim": 1, "sim-2": 2}
BOTH = "viscous+coulomb"


def inverse(function: Callable[[str], str], names: Any) -> dict[str, str]:
    return {function(name): name for name in names}


MODEL = inverse(lambda m: words.model(m).lower(), ("viscous", BOTH))
METHOD = inverse(words.method, (*METHODS, "nuts", "emcee", "importance", "bridge"))
STAGE = inverse(words.stage, ("initial", "refined"))
PARAMETER = inverse(lambda n: words.symbol(n).text, ("zeta", "mu_c", *SHARED["bench"], "natural_frequency"))


class Folder:
    """The tables and verdicts of a run's folder, read without the program, and the rows that were looked up."""

    def __init__(self, folder: Path) -> None:
        names = "estimates", "posteriors", "evidence", "fits"
        self.tables = {name: pd.read_csv(folder / f"{name}.csv") for name in names}
        self.looked_up: dict[str, set[int]] = {name: set() for name in self.tables}
        self.verdicts = {v["record"]: v for v in json.loads((folder / "verdict.json").read_text())}

    def rows(self, table: str, **wanted: object) -> pd.DataFrame:
        columns = (self.tables[table][column].to_numpy(object) == value for column, value in wanted.items())
        rows = self.tables[table][np.logical_and.reduce(list(columns))]
        self.looked_up[table] |= set(rows.index)
        return rows

    def row(self, table: str, **wanted: object) -> Any:
        (row,) = self.rows(table, **wanted).to_dict("records")
        return row

    def truth(self, signal: str, parameter: str) -> float:
        rows = self.tables["estimates"]
        return rows[(rows.signal == signal) & (rows.parameter == parameter)].truth.max()


def sized(v: Any, scale: float = 1.0) -> dict[str, float]:
    return {part: scale * v[part] for part in ("value", "low", "high")}


def named(prefix: str, numbers: dict[str, float]) -> dict[str, float]:
    return {f"{prefix} {part}": value for part, value in numbers.items()}


def of_sentence(v: Any, unit: float) -> dict[str, float]:
    """Return the numbers of an answer's sentence in the order in which they are read."""

    def with_width(i: Any) -> dict[str, float]:
        uneven = (i["high"] - i["value"]) > 1.25 * (i["value"] - i["low"])
        return sized(i) if uneven else {"value": i["value"], "half": 0.5 * (i["high"] - i["low"])}

    size: dict[str, float] = {}
    for i, r in enumerate(v["damping_ratio"]):
        if i in (0, len(v["damping_ratio"]) - 1):
            size |= named(f"ratio {i and 'last'}", sized(r, 100) | {"amplitude": unit * r["amplitude"]})
    if at := v["frequency_at"]:
        size |= named("frequency at", with_width(at) | {"amplitude": unit * at["amplitude"]})
    size |= named("frequency", with_width(v["frequency"]))
    within = 100 * v["deviation"]["high"] if v["deviation"] else math.nan
    if v["decided"]:
        shares = of_energy(v) if "+" in v["damping"] else {}
        return {"probability": v["probability"], **size, **shares, "law": within}
    rivals = {f"probability of {r['damping']}": r["probability"] for r in v["rivals"]}
    law = {"law": 100 * v["deviation"]["value"], "95": 95.0, "law below": within}
    return {**size, "probability": v["probability"], **rivals, **law}


def of_energy(v: Any) -> dict[str, float]:
    return {f"{s['term']} {p}": 100 * s[p] for s in v["energy"] for p in ("share", "low", "high")}


def of_ratio(r: Any, unit: float) -> dict[str, Stored]:
    return {
        "amplitude": {"": unit * r["amplitude"]}, "equivalent damping ratio (95 %)": sized(r, 100),
        "Q": {"value": 0.5 / r["value"], "low": 0.5 / r["high"], "high": 0.5 / r["low"]},
        "sd from noise": {"": 100 * r["sd_noise"]}, "sd from the law": {"": 100 * r["sd_law"]},
    }  # fmt: skip


def of_answer_table(v: Any, signal: str, i: int, cells: dict[str, str]) -> dict[str, Stored]:
    if "amplitude" in cells:
        return of_ratio(v["damping_ratio"][i], UNIT[signal])
    if "restoring law" in cells:
        log, exact, rms = CANDIDATES[MODEL[cells["damping"].lower()]]
        best, best_exact = (max(each) for each in list(zip(*CANDIDATES.values()))[:2])
        shown = {
            "log Bayes factor": {"": log - best}, "log Bayes factor under exact laws": {"": exact - best_exact},
        }  # fmt: skip
        return {**shown, f"rms residual, {'deg' if signal == 'bench' else 'rad'}": {"": rms * UNIT[signal]}}
    own = next(a for a in v["coefficients"] if a["name"] == PARAMETER[cells["parameter"]])
    sds = {f"sd from {a}": {"": own[b]} for a, b in (("noise", "sd_noise"), ("the law", "sd_law"))}
    return {"value (95 %)": sized(own), **sds, "unit": own["unit"]}


def of_posterior(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    name = PARAMETER[cells["parameter"]]
    r = f.row("posteriors", **at, parameter=name, sampler=METHOD[cells["sampler"]])
    each = {"R̂": "rhat", "ESS bulk": "ess_bulk", "ESS tail": "ess_tail", "divergences": "divergences"}
    return {
        "mean ± sd": {"mean": r["mean"], "sd": r["sd"]}, "95 % interval": {"low": r["q2.5"], "high": r["q97.5"]},
        "truth": {"": f.truth(at["signal"], name)}, "unit": r["unit"], "outcome": r["outcome"],
        **{header: {"": r[column]} for header, column in each.items()},
    }  # fmt: skip


def of_estimate(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    count, at = COUNTS[at["signal"]], {"signal": at["signal"], "model": at["model"]}
    rows = f.rows("estimates", **at, estimator=METHOD[cells["estimator"]], stage=STAGE[cells["stage"]])
    bad = rows.outcome[rows.outcome != "ok"].to_list()
    stored: dict[str, Stored] = {
        "evaluations": {"": rows.evaluations.max()}, "time": {"": rows.seconds.max()},
        "outcome": " × ".join([str(len(bad))] * (count > 1) + bad[:1]) if bad else "ok",
    }  # fmt: skip
    for term in at["model"].split("+"):
        name, unit = OWN[term]
        symbol, own = words.symbol(name).text, rows[rows.parameter == name]
        value = {"value": own.value.max(), "sd": own.stderr.max()}
        errors, extent = own.error_pct.abs(), {"least": own.value.min(), "largest": own.value.max()}
        error = {"least": errors.min(), "largest": errors.max()} if count > 1 else {"": errors.max()}
        stored[f"{symbol} / ({unit})"] = value if count == 1 else extent
        stored[f"error of {symbol} / %" if at["model"] == BOTH else "error / %"] = error
    return stored


def of_evidence(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    r = f.row("evidence", **at, method=METHOD[cells["method"]])
    return {
        "log evidence / nats": {"value": r["log_evidence"], "sd": r["stderr"]},
        "log Bayes factor": {"": r["log_bayes_factor"]}, "probability": {"": r["probability"]},
        "diagnostic": "–" if pd.isna(r["diagnostic"]) else r["diagnostic"],
    }  # fmt: skip


def of_fit(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    r = f.row("fits", **at)
    assert cells["rms residual"].endswith(f" {r['rms_unit']}")
    each = {
        "rms residual": "rms", "autocorrelation": "residual_autocorrelation", "predictive p": "predictive_p",
        "stability over sub-records": "window_spread",
    }  # fmt: skip
    return {**{header: {"": r[column]} for header, column in each.items()}, "verdict": r["verdict"]}


def of_overview(v: Any, unit: float) -> dict[str, Stored]:
    r, deviation = v["damping_ratio"][len(v["damping_ratio"]) // 2], v["deviation"] or {"high": math.nan}
    return {
        "probability": {"": v["probability"]},
        "frequency / Hz": {"": v["frequency"]["value"]},
        "damping ratio (95 %), amplitude": sized(r, 100) | {"amplitude": unit * r["amplitude"]},
        "deviation from the law below / %": {"": 100 * max(deviation["high"], 0.001)},
        "unexplained / %": {"": v["unexplained_pct"]},
    }


def of_population() -> dict[str, Stored]:
    r, names = OF_SPECIMENS, ("mean", "spread")
    sizes = {f"{n} (95 %)": {"": r[n], "low": r[f"{n}_low"], "high": r[f"{n}_high"]} for n in names}
    return {**sizes, "one more specimen (95 %)": {"from": r["next_low"], "to": r["next_high"]}, "unit": "1/s"}


def of_study(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    samples, duration = (5000, 4999 / 260) if cells["signal"] == "bench" else (1000, 10)
    return {
        "repeats": {"": COUNTS[cells["signal"]]}, "samples used": {"": samples}, "duration / s": {"": duration},
    }  # fmt: skip


def of_odds(f: Folder, at: dict[str, Any], cells: dict[str, str]) -> dict[str, Stored]:
    """Return the probability of a damping with half, once and twice the prior odds of a second term."""
    rows = f.rows("evidence", signal=at["signal"], repeat=0, method="bridge").set_index("model").probability
    both, alone = rows[BOTH], rows["viscous"]
    shares = [factor * both / (factor * both + alone) for factor in (0.5, 1, 2)]
    shares = shares if MODEL[cells["damping"].lower()] == BOTH else [1 - p for p in shares]
    return {header: {"": p} for header, p in zip([h for h in cells if h.startswith("factor")], shares)}


OF_SECTION = {
    "posteriors": ("sampler", of_posterior), "estimates": ("evaluations", of_estimate), "study": ("origin", of_study),
    "evidence": ("method", of_evidence), "fit_quality": ("rms residual", of_fit),
}  # fmt: skip
"""A header of each section's table of a CSV file, and the stored numbers of its rows."""
KIND = {"amplitude": "ratio", "parameter": "coefficient", "damping": "candidate"}
"""What an answer's table has in its rows, by its first header."""
