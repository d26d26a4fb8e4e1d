"""The shipped pages on simulated records agree with the truth of these records."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from bayesdamp.store.files import TABLES, read_table, write_table
from validation.reports.contradictions import (
    INTERVAL,
    contradictions,
    intervals_of_many,
    misses,
    names_of_many,
)
from validation.truth.oscillator import Oscillator
from validation.truth.ratio import true_ratio

ROOT = Path(__file__).parents[3]
REPORTS = ROOT / "reports"
PAGES = sorted(p.name for p in REPORTS.iterdir() if p.is_dir())
PAPER = Oscillator(
    "horizontal_pendulum", {"stiffness": 20.0, "spring_angle": 0.0, "gravity": 1.0}, {"coulomb": 0.03}, 0.1
)


def test_no_shipped_page_contradicts_the_truth() -> None:
    assert {name: faults for name in PAGES if (faults := contradictions(REPORTS / name))} == {}


# Negative controls: pages with a fault.

RATIO = true_ratio(PAPER, 0.25)
RATIO_AT = {"amplitude": 0.25, "unit": "rad", "value": RATIO, "sd_noise": 0.0, "sd_law": 0.0}
VERDICT: dict[str, Any] = {
    "record": "coulomb-noisy", "decided": True, "damping": "coulomb", "probability": 0.99,
    "rivals": [{"damping": "quadratic", "probability": 0.01}],
    "damping_ratio": [RATIO_AT | {"low": 0.99 * RATIO, "high": 1.01 * RATIO}],
}  # fmt: skip
POSTERIOR = {"sampler": "nuts", "parameter": "mu_c", "q2.5": 0.0299, "q97.5": 0.0301, "outcome": "ok"}
IMPROBABLE = {"damping": "coulomb", "probability": 0.001}
EXCLUDING = {"decided": False, "damping": "quadratic", "rivals": [IMPROBABLE]}
OUTSIDE = {"damping_ratio": [RATIO_AT | {"low": 1.1 * RATIO, "high": 1.12 * RATIO}]}


def page_of(folder: Path, **wrong: dict[str, Any]) -> Path:
    """Write a page on the paper's Coulomb pendulum, with the given faults in its verdict or its table."""
    run = json.loads((REPORTS / "paper" / "run.json").read_text(encoding="utf-8"))
    signals = [s for s in run["study"]["signals"] if s["name"] == "coulomb-noisy"]
    (folder / "run.json").write_text(json.dumps({"study": {"signals": signals}}), encoding="utf-8")
    verdicts = json.loads((REPORTS / "paper" / "verdict.json").read_text(encoding="utf-8"))
    (verdict,) = (v for v in verdicts if v["record"] == "coulomb-noisy")
    verdict |= VERDICT | wrong.get("verdict", {})
    (folder / "verdict.json").write_text(json.dumps([verdict]), encoding="utf-8")
    rows = read_table(REPORTS / "paper" / "posteriors.csv")
    row = next(r for r in rows if (r["signal"], r["model"]) == ("coulomb-noisy", "coulomb"))
    row |= POSTERIOR | wrong.get("posterior", {})
    write_table(folder / "posteriors.csv", TABLES["posteriors.csv"], [row])
    return folder


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        ({}, None),
        ({"verdict": {"damping": "quadratic"}}, "quadratic is named, but the truth is coulomb"),
        ({"verdict": EXCLUDING}, "the true damping, coulomb, has a probability of 0.001"),
        ({"verdict": OUTSIDE}, "but the truth is"),
        ({"posterior": {"q2.5": 0.0303, "q97.5": 0.0305}}, "mu_c by nuts"),
    ],
)
def test_only_a_wrong_page_is_reported(tmp_path: Path, fault: dict[str, Any], text: str | None) -> None:
    faults = contradictions(page_of(tmp_path, **fault))
    assert any(text in line for line in faults) if text else faults == []


def test_as_many_misses_as_chance_allows_are_not_reported() -> None:
    """Five of 100 intervals of 95 % are expected to miss; fifteen have a probability of 4e-5."""

    def intervals(misses: int) -> pd.DataFrame:
        rows = [(str(i), "x", 1.0, 2.0, 2.1 if i < misses else 1.5) for i in range(100)]
        return pd.DataFrame(rows, columns=INTERVAL)

    assert misses(intervals(5)) == []
    assert len(misses(intervals(15))) == 15

    right = pd.DataFrame([{
        "record": "x", "peer": "y", "outcome": "ok", "named": "viscous", "decided": 1, "right": 1, "probability": 0.97,
        "true_probability": 0.97, "low_1": 1.0, "high_1": 2.0, "true_1": 1.5, "low_2": np.nan,
    }] * 20)  # fmt: skip
    wrong = right.assign(right=0, true_probability=0.03)
    some = pd.concat([right.iloc[:17], wrong.iloc[:1], *[right] * 4])
    assert names_of_many(some, "x") == []
    assert "named wrongly" in names_of_many(right.assign(right=0), "x")[0]
    assert "exclude the true damping" in names_of_many(right.assign(true_probability=0.03), "x")[0]
    far = right.assign(record=[str(i) for i in range(20)], true_1=2.5)
    assert len(misses(intervals_of_many(far))) == 20
