"""Errors of the estimators, compared with each other and along a factor of the simulated records."""

import math
from pathlib import Path

import pytest

from bayesdamp.report.results.estimators import error_series
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import render
from bayesdamp.store.files import TABLES, write_json, write_table
from bayesdamp.store.results import claim
from tests.report.pages import Tables

ERRORS = {"least_squares": (1.0, 0.01), "genetic": (4.0, 0.01), "topological": (90.0, 0.01)}
"""Method to its error in per cent at 1 % noise, initial and refined; at other noise in proportion."""
TRUTHS = {"viscous": ("zeta", 0.05), "coulomb": ("mu_c", 0.03)}
LEVELS = (0.0, 0.5, 1.0, 2.0)
NAMES = {0.0: "clean", 0.5: "half", 1.0: "base", 2.0: "twice"}


def source(damping: str, level: float, samples: int = 701) -> dict:
    truth = {TRUTHS[damping][0]: TRUTHS[damping][1], "theta0": 0.3, "noise_sd": 0.003 * level}
    return {"damping": [damping], "truth": truth, "duration": 9.8, "samples": samples}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    claim(tmp_path)
    rows, signals, about, rest = [], [], {}, {}
    for damping, (parameter, truth) in TRUTHS.items():
        for level in LEVELS:
            name = f"{damping}-{NAMES[level]}"
            system = {"known": {"stiffness": 20.05}}
            signals.append({"name": name, "source": source(damping, level), "system": system})
            bound = {parameter: 0.002 * level * truth} if level else {}
            about[name] = {"simulated": True, "unit": "deg", "reference": {"amplitude": 0.3}, "bound": bound}
            rest[name] = {"equilibrium": 0.05, "natural_frequency": 4.478}
            for repeat in (0, 1):
                for method, errors in ERRORS.items():
                    for stage, error in zip(("initial", "refined"), errors):
                        off = error * level * (1 if repeat else -1)
                        common = {"signal": name, "repeat": repeat, "model": damping, "estimator": method}
                        rows.append({
                            **common, "stage": stage, "parameter": parameter, "unit": "1/s",
                            "value": truth * (1 + off / 100), "truth": truth, "error_pct": abs(off),
                            "evaluations": 1, "seconds": 0.5, "outcome": "ok",
                        })  # fmt: skip
                        # Another model than the true one: not an error of the method.
                        rows.append({**rows[-1], "model": "quadratic", "parameter": "mu_q", "error_pct": 1e6})
    for name, columns in TABLES.items():
        write_table(tmp_path / name, columns, rows if name == "estimates.csv" else [])
    printed = {"estimator": "genetic", "signal": "viscous-base", "error_pct": "~0", "time": "2–5 min"}
    info = {
        "name": "made up", "models": ["viscous", "coulomb", "quadratic"], "signals": about, "equilibrium": rest,
        "study": {"signals": signals, "published": [printed, {**printed, "signal": "coulomb-base"}]},
    }  # fmt: skip
    write_json(tmp_path / "run.json", info)
    return tmp_path


def test_the_page_compares_errors_under_the_true_model_and_times_with_published_ones(folder):
    """Mean errors of two repeats; times are sums over two signals and two repeats."""
    page = render(folder).read_text(encoding="utf-8")
    errors, times = (table.rows for table in Tables(page).tables if table.path[0] == "comparison")
    assert errors == [
        ["topological", "classical", *["90", "0.010", "–"] * 3],
        ["least squares", "classical", *["1.0", "0.010", "–"] * 3],
        ["genetic", "optimisation", *["4.0", "0.010", "~0"] * 2, "4.0", "0.010", "0"],
    ]
    published = {"topological": "–", "least squares": "–", "genetic": "2–5 min"}
    assert times == [[method, "2.0 s", "2.0 s", text] for method, text in published.items()]
    assert f"equilibrium {math.degrees(0.05):.4g} deg and the natural frequency 4.478 rad/s." in page
    assert " = 20.05." in page  # the known stiffness
    assert "Errors against noise" in page
    assert "of the true values, over 2 repeats, against the noise" in page
    figures = {path.name: path.read_text(encoding="utf-8") for path in (folder / "figures").iterdir()}
    assert "topological, 2<" in figures["sweep-viscous-noise.svg"]  # the number of repeats
    ticks = [figures["sweep-viscous-noise.svg"].index(f">{level:g}</text>") for level in LEVELS]
    assert ticks == sorted(ticks)
    assert {"estimates-viscous-base-viscous.svg", "sweep-viscous-noise.svg"} <= set(figures)


def test_a_series_contains_records_that_differ_in_one_factor(folder):
    """Control: signals that also differ in their sampling or in their damping coefficient are in no series."""
    result = error_series(RunFolder(folder))
    assert [(s.model, s.factor) for s in result] == [("viscous", "noise"), ("coulomb", "noise")]
    assert result[0].values == list(LEVELS)
    assert result[0].errors.loc["genetic", "initial"].tolist() == pytest.approx([0.0, 2.0, 4.0, 8.0])
    assert result[0].repeats["genetic", "initial"].tolist() == [2] * 4
    assert math.isnan(result[0].bounds[0])
    assert result[0].bounds[1:] == pytest.approx([0.1, 0.2, 0.4])
    for change in ({"samples": 71}, {"truth": {"zeta": 0.1, "theta0": 0.3, "noise_sd": 0.003}}):
        run = RunFolder(folder)
        for signal in run.study["signals"][1:3]:
            signal["source"] |= change
        assert [(s.model, s.factor) for s in error_series(run)] == [("coulomb", "noise")]
    # 70, 140, ... intervals in 7.0 periods.
    for signal, samples in zip(run.study["signals"], (71, 141, 351, 701)):
        signal["source"] = source("viscous", 1.0, samples)
    assert [s.values for s in error_series(run) if s.factor == "sampling"] == [[10, 20, 50, 100]]
