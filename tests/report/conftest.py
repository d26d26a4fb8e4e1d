"""Folders of runs, made without running anything: one measured and one simulated signal."""

from __future__ import annotations

import functools
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.store import TABLES, CellResult, Store, write_json, write_table
from bayesdamp.store.contents import FeaturesSeen, WeighedCandidate
from bayesdamp.verdict.parts import (
    Bound,
    Coefficient,
    DampingRatio,
    FrequencyAt,
    Grade,
    Interval,
    Rival,
    Share,
)
from bayesdamp.verdict.types import Verdict, save_verdicts
from bayesdamp.verdict.words import sentence

MODELS = ("viscous", "coulomb", "quadratic", "viscous+coulomb")
OWN = {"viscous": ("zeta", "1/s"), "coulomb": ("mu_c", "rad/s²"), "quadratic": ("mu_q", "1/rad")}
SIZE = {
    "bench": {"zeta": (0.1292, 0.0005), "mu_c": (0.1340, 0.003), "mu_q": (0.021, 0.0004)},
    "sim": {"zeta": (0.0501, 0.0002), "mu_c": (0.031, 0.0006), "mu_q": (0.092, 0.002)},
}
SHARED = {
    "bench": {
        "stiffness": (491.2, 0.4, "1/s²"),
        "gravity": (-243.1, 0.6, "rad/s²"),
        "noise_sd": (0.0021, 2e-5, "rad"),
    },
    "sim": {"noise_sd": (0.0030, 3e-5, "rad")},
}
LOG_BAYES = {
    "bench": {"viscous+coulomb": 0.0, "viscous": -801.3, "coulomb": -3056.2, "quadratic": -5210.0},
    "sim": {"viscous": 0.0, "viscous+coulomb": -1.4, "coulomb": -912.0, "quadratic": -455.0},
}
TRUTH = {"zeta": 0.05, "mu_c": 0.0, "mu_q": 0.0}
METHODS = (
    "least_squares", "envelope", "topological", "koopman", "sindy", "weak_sindy", "pinn", "neural_ode", "rnn",
    "symbolic_regression", "genetic",
)  # fmt: skip


DETAILS = {
    "sindy": {"selected": ["2θ̇", "θ"], "coefficients": [0.0502, 20.1], "knots_per_period": 4.4},
    "symbolic_regression": {
        "chosen": "f(v) = 0.1·v",
        "pareto_chosen": 1,
        "pareto_length": [1, 3],
        "pareto_error": [0.2, 1e-3],
        "pareto_expression": ["v", "0.1·v"],
    },
    "koopman": {"generator_eigenvalues_re": [-0.05, -0.05], "generator_eigenvalues_im": [4.48, -4.48]},
    "neural_ode": {"velocity": [-1.0, 0.0, 1.0], "force": [-0.11, 0.0, 0.1], "law": [-0.1, 0.0, 0.1]},
}
"""What some methods say besides their estimates."""

RATIOS = (
    DampingRatio(0.51, "rad", 0.006512, 2.1e-5, 4.7e-5, 0.006411, 0.006618),
    DampingRatio(0.22, "rad", 0.007324, 2.6e-5, 5.9e-5, 0.007203, 0.007456),
    DampingRatio(0.073, "rad", 0.011283, 7.3e-5, 1.7e-4, 0.010922, 0.011651),
)
VERDICTS = (
    Verdict(
        "bench", Grade.EXACT, True, "viscous+coulomb", 0.9783, (Rival("viscous", 0.0217),), "horizontal_pendulum",
        damping_ratio=RATIOS, frequency=Interval(3.9903, 3.9889, 3.9917, "Hz"), unexplained_pct=0.83,
        deviation=Interval(0.0112, 0.0031, 0.0264),
        energy=(Share("viscous", 0.612, 0.583, 0.644, 1.0), Share("coulomb", 0.388, 0.356, 0.417, 0.98)),
        other_forms=(Bound("quadratic", 0.0087),),
        coefficients=(Coefficient("zeta", 0.12932, 2.7e-4, 6.1e-4, 0.12801, 0.13064, "1/s"),
                      Coefficient("mu_c", 0.13417, 1.3e-3, 2.9e-3, 0.12791, 0.14038, "rad/s²")),
    ),
    Verdict(
        "sim", Grade.APPROXIMATE, False, "viscous", 0.8134, (Rival("viscous+coulomb", 0.1523),), "horizontal_pendulum",
        damping_ratio=RATIOS[1:], frequency=Interval(0.71265, 0.70912, 0.71618, "Hz"), unexplained_pct=1.27,
        frequency_at=FrequencyAt(0.073, "rad", 0.70116, 0.70093, 0.70139), deviation=Interval(0.0423, 0.0112, 0.0861),
        energy=(Share("viscous", 0.887, 0.711, 0.973, 0.99), Share("coulomb", 0.113, 0.027, 0.289, 0.18)),
        coefficients=(Coefficient("zeta", 0.05017, 1.2e-4, 3.1e-4, 0.04951, 0.05082, "1/s"),),
    ),
    Verdict(
        "sim-2", Grade.EXACT, True, "viscous", 0.9871, (Rival("viscous+coulomb", 0.0129),), "horizontal_pendulum",
        damping_ratio=RATIOS[:1], frequency=Interval(0.71265, 0.71193, 0.71618, "Hz"), unexplained_pct=0.41,
    ),
)  # fmt: skip
CANDIDATES = {"viscous": (-812.34, -1204.6, 0.03127), "viscous+coulomb": (321.7, 298.2, 0.00213)}
"""Log evidence, log evidence under exact laws and rms residual in rad."""


def stages(method: str) -> list[dict]:
    own = {"estimator": method, "stage": "initial", "details": DETAILS.get(method, {})}
    return [own, {"estimator": method, "stage": "refined", "details": {}}]


def trajectory(signal: str, model: str, t: np.ndarray) -> np.ndarray:
    """A decay that looks like this model's, in rad."""
    rate, frequency = (0.13, 25.1) if signal == "bench" else (0.05, 4.47)
    start = 0.5 if signal == "bench" else 0.3
    envelopes = {
        "viscous": np.exp(-1.06 * rate * t),
        "coulomb": np.maximum(1 - 0.62 * rate * t, 0.0),
        "quadratic": 1 / (1 + 1.7 * rate * t),
        "viscous+coulomb": np.maximum(np.exp(-rate * t) - 0.02 * t / t[-1], 0.0),
    }
    return start * envelopes[model] * np.cos(frequency * t)


class RunMaker:
    """Writes the folder of a run; `cells`, `tables` and `signals` say what of it."""

    def __init__(self, folder: Path, signals=("bench", "sim"), repeats=None, models=MODELS) -> None:
        self.folder = folder
        self.store = Store(folder)
        self.signals = list(signals)
        self.repeats = repeats or {"bench": 1, "sim": 2}
        self.models = models
        self.rng = np.random.default_rng(7)
        self.tables: dict[str, list[dict]] = {name: [] for name in TABLES}

    def kind(self, signal: str) -> str:
        return "bench" if signal.startswith("bench") else "sim"

    def make(self) -> Path:
        for signal in self.signals:
            for repeat in range(self.repeats.get(signal, 1)):
                t, y = self.signal(signal, repeat)
                for model in self.models:
                    self.mode(signal, repeat, model, t, y)
                    self.estimates(signal, repeat, model)
                    self.posterior(signal, repeat, model)
                    self.evidence(signal, repeat, model)
        for name, rows in self.tables.items():
            write_table(self.folder / name, TABLES[name], rows)
        write_json(self.folder / "run.json", self.info())
        return self.folder

    def put(self, name: str, meta: dict, arrays: dict, outcome: str = "ok") -> None:
        self.store.write(CellResult(name, "key", meta, arrays, outcome, float(self.rng.exponential(2.0))))

    def signal(self, signal: str, repeat: int) -> tuple[np.ndarray, np.ndarray]:
        kind = self.kind(signal)
        t = np.arange(5000) / 260.0 if kind == "bench" else np.linspace(0, 10, 1000)
        best = "viscous+coulomb" if kind == "bench" else "viscous"
        noise = np.convolve(self.rng.normal(0, 1.0, t.size + 40), np.exp(-np.arange(41) / 12), "valid")
        y = trajectory(kind, best, t)
        y = y + (0.0006 * noise if kind == "bench" else self.rng.normal(0, 0.003, t.size))
        arrays = {"t": t, "y": y}
        features = FeaturesSeen(
            rest=0.0,
            amplitude=0.3,
            final_amplitude=0.1,
            frequency=4.5,
            period=0.25 if kind == "bench" else 1.405,
            cycles=9.0,
            samples_per_cycle=140.0,
            roughness=0.001,
        )
        meta: dict = {"features": asdict(features)}
        if kind == "bench":
            before, after = np.full(520, y[0]), np.full(1300, 0.0088)
            raw = np.concatenate([before, y, after])
            arrays |= {"raw_t": np.arange(raw.size) / 260.0, "raw_y": raw}
            meta["provenance"] = {"start": 2.0, "stop": 21.23}
        self.put(f"signal/{signal}/{repeat}", meta, arrays)
        return t, y

    def mode(self, signal: str, repeat: int, model: str, t: np.ndarray, y: np.ndarray) -> None:
        kind = self.kind(signal)
        fit = trajectory(kind, model, t)
        residual = y - fit
        size = {n: SIZE[kind][n] for n, _ in (OWN[term] for term in model.split("+"))}
        lags = np.arange(26)
        rho = 0.94 if kind == "bench" else 0.0
        autocorrelation = np.where(lags == 0, 1.0, 0.25 * rho**lags + self.rng.normal(0, 0.02, lags.size))
        windows = [
            {
                "label": label,
                "start": start * t[-1],
                "stop": stop * t[-1],
                "values": {n: v + (0 if i == 0 else self.rng.normal(0, 3 * s)) for n, (v, s) in size.items()},
                "sd": {n: s * (1 + 0.4 * i) for n, (_, s) in size.items()},
            }
            for i, (label, start, stop) in enumerate(
                [("whole", 0, 1), ("first half", 0, 0.5), ("second half", 0.5, 1), ("middle", 0.25, 0.75)]
            )
        ]
        meta = {
            "values": {n: v for n, (v, _) in size.items()},
            "sd": {n: s for n, (_, s) in size.items()},
            "log_posterior": 1234.5,
            "error_budget": {"step_error": 2e-8, "log_likelihood_change": 0.0021},
            "windows": windows,
        }
        arrays = {"t": t, "fit": fit, "residual": residual, "whitened": residual / residual.std()}
        self.put(f"mode/{signal}/{repeat}/{model}", meta, {**arrays, "autocorrelation": autocorrelation})
        factor, unit = (180 / math.pi, "deg") if kind == "bench" else (1.0, "rad")
        best = LOG_BAYES[kind][model] > -2
        self.tables["fits.csv"].append(
            {
                "signal": signal,
                "repeat": repeat,
                "model": model,
                "restoring": "horizontal_pendulum",
                "rms": residual.std() * factor,
                "rms_unit": unit,
                "residual_autocorrelation": float(autocorrelation[1]),
                "window_spread": 4.1 if kind == "bench" else 0.6,
                "predictive_p": (0.003 if kind == "bench" else 0.41) if best else 0.0,
                "verdict": "the residual is as small as the noise"
                if best
                else "the residual is far above the noise",
            }
        )

    def estimates(self, signal: str, repeat: int, model: str) -> None:
        kind = self.kind(signal)
        for i, method in enumerate(METHODS):
            common = {"signal": signal, "repeat": repeat, "model": model, "estimator": method}
            if method == "envelope" and "+" in model:
                outcome = "refuses: the envelope of a sum of dampings has no closed form here"
                self.tables["estimates.csv"].append(
                    {**common, "stage": "initial", "outcome": outcome, "seconds": 0.0}
                )
                continue
            for stage in ("initial", "refined"):
                rough = [30, 8, 400, 12, 25, 3, 60, 150, 90, 45, 5][i] if stage == "initial" else 0.2
                for term in model.split("+"):
                    name, unit = OWN[term]
                    value, sd = SIZE[kind][name]
                    value = 0.0 if kind == "sim" and name == "mu_c" and "+" in model else value
                    value += sd * rough * self.rng.normal()
                    true = TRUTH[name] if kind == "sim" else math.nan
                    self.tables["estimates.csv"].append(
                        {
                            **common,
                            "stage": stage,
                            "parameter": name,
                            "unit": unit,
                            "value": value,
                            "stderr": sd if stage == "refined" else math.nan,
                            "truth": true,
                            "error_pct": 100 * (value / true - 1) if true else math.nan,
                            "evaluations": 300 * (i + 1) * (repeat + 1),
                            "seconds": 0.3 * (i + 1) * (repeat + 1),
                            "outcome": "ok",
                        }
                    )
            steps = np.arange(200)
            trace = {"initial/loss": np.exp(-steps / 40) + 1e-4} if method == "pinn" else {}
            self.put(f"estimate/{signal}/{repeat}/{model}/{method}", {"stages": stages(method)}, trace)

    def posterior(self, signal: str, repeat: int, model: str) -> None:
        kind = self.kind(signal)
        size = [(*OWN[term], *SIZE[kind][OWN[term][0]]) for term in model.split("+")]
        size += [(n, u, v, s) for n, (v, s, u) in SHARED[kind].items()]
        names, units = [s[0] for s in size], [s[1] for s in size]
        mean, sd = np.array([s[2] for s in size]), np.array([s[3] for s in size])
        if kind == "sim" and "coulomb" in model:
            mean[names.index("mu_c")] = 0.0
        for sampler in ("nuts", "emcee"):
            draws = mean + sd * self.rng.normal(size=(4, 1000, len(names)))
            if "+" in model and mean[1]:
                tilt = 0.9 * sd[1] / sd[0] * (draws[..., 0] - mean[0])
                draws[..., 1] = mean[1] - tilt + 0.44 * (draws[..., 1] - mean[1])
            own = [n in TRUTH for n in names]
            draws[..., own] = np.abs(draws[..., own])
            slow = sampler == "emcee" and model == "quadratic"
            outcome = "not converged: R̂ of stiffness is 1.034, above 1.01" if slow else "ok"
            self.put(
                f"posterior/{signal}/{repeat}/{model}/{sampler}",
                {
                    "posterior": {"sampler": sampler, "names": names, "draws": [], "log_likelihood": []},
                    "units": dict(zip(names, units)),
                },
                {"draws": draws},
                outcome,
            )
            flat = draws.reshape(-1, len(names))
            derived = [("natural_frequency", "rad/s", np.sqrt(20 + 0.001 * self.rng.normal(size=len(flat))))]
            columns = [*((n, u, flat[:, i]) for i, (n, u) in enumerate(zip(names, units))), *derived]
            for name, unit, x in columns:
                q = dict(
                    zip(
                        ("q2.5", "q25", "median", "q75", "q97.5"),
                        np.quantile(x, [0.025, 0.25, 0.5, 0.75, 0.975]),
                    )
                )
                self.tables["posteriors.csv"].append(
                    {
                        "signal": signal,
                        "repeat": repeat,
                        "model": model,
                        "sampler": sampler,
                        "parameter": name,
                        "unit": unit,
                        "mean": x.mean(),
                        "sd": x.std(),
                        **q,
                        "hdi_low": q["q2.5"],
                        "hdi_high": q["q97.5"],
                        "ess_bulk": 3900.0 if sampler == "nuts" else 1200.0,
                        "ess_tail": 2800.0,
                        "rhat": 1.034 if slow and name == "stiffness" else 1.001,
                        "divergences": 0 if sampler == "nuts" else None,
                        "seconds": 4.0,
                        "outcome": outcome,
                    }
                )

    def evidence(self, signal: str, repeat: int, model: str) -> None:
        kind = self.kind(signal)
        logs = {m: LOG_BAYES[kind][m] for m in self.models}
        total = sum(math.exp(v) for v in logs.values())
        for method in ("importance", "bridge"):
            poor = method == "importance" and model == "viscous+coulomb" and kind == "sim"
            row = {
                "signal": signal,
                "repeat": repeat,
                "model": model,
                "restoring": "horizontal_pendulum",
                "method": method,
                "log_evidence": 29362.41 + logs[model] + (0.02 if method == "bridge" else 0.0),
                "stderr": 0.008,
                "log_bayes_factor": logs[model] - max(logs.values()),
                "probability": math.exp(logs[model]) / total,
                "diagnostic": "Pareto k 0.81: poor"
                if poor
                else "Pareto k 0.21"
                if method == "importance"
                else "",
                "outcome": "ok",
            }
            self.tables["evidence.csv"].append(row)
            self.put(f"evidence/{signal}/{repeat}/{model}/{method}", {}, {})

    def info(self) -> dict:
        about = {
            "bench": {
                "notes": [
                    "94 % of the time stamps repeat: the clock was rebuilt as index × mean step (260.0 Hz).",
                    "The first 2.00 s, before the release, and all after 21.23 s, at rest, were cut off.",
                    "Recording step 0.088 deg.",
                ],
                "unit": "deg",
                "quantity": "angle",
                "simulated": False,
                "epsilon_note": "ε was not given: 2 % of the peak velocity, 0.25 rad/s.",
            },
            "sim": {"notes": ["Simulated."], "unit": "rad", "quantity": "angle", "simulated": True},
        }
        priors = {
            model: {
                **{OWN[term][0]: "halfnormal(scale 0.45)" for term in model.split("+")},
                "stiffness": "lognormal(median 630, sigma 0.5)",
                "noise_sd": "lognormal(median 0.0021, sigma 1)",
            }
            for model in self.models
        }
        seconds = {name: self.store.read(name).seconds for name in self.store.names()}
        return {
            "name": "two pendulums",
            "description": "One measured and one simulated decay",
            "study": {
                "version": 1,
                "name": "two pendulums",
                "seed": 20260101,
                "signals": [
                    {
                        "name": name,
                        "system": {
                            "restoring": "horizontal_pendulum",
                            "known": {"stiffness": 20.0, "epsilon": 0.1},
                            "free": {"noise_sd": None},
                        },
                    }
                    for name in self.signals
                ],
                "estimators": {"use": list(METHODS), "stages": ["initial", "refined"]},
                "models": {"compare": list(self.models)},
                "posterior": {"samplers": ["nuts", "emcee"], "noise": "correlated"},
                "evidence": {"methods": ["importance", "bridge"], "referee": "auto"},
            },
            "seed": 20260101,
            "versions": {"numpy": "2.1.0", "jax": "0.5.0"},
            "revision": "0123456789abcdef",
            "machine": {"system": "Linux", "processor": "a processor", "cpus": 2, "python": "3.11.9"},
            "inputs": {"bench.txt": "ab" * 32},
            "seconds": seconds,
            "signals": {name: about[self.kind(name)] for name in self.signals},
            "priors": {name: priors for name in self.signals},
            "models": list(self.models),
            "error_budget": {
                name: {model: {"step_error": 2e-8, "log_likelihood_change": 0.0021} for model in self.models}
                for name in self.signals
            },
        }


def write_answers(folder: Path) -> None:
    """Give the records of VERDICTS their answers, with sentences as they are written now."""
    store = Store(folder)
    verdicts = [replace(v, sentence=sentence(v)) for v in VERDICTS]
    for v in verdicts:
        candidates = [
            asdict(WeighedCandidate(name, v.restoring, log, exact, rms))
            for name, (log, exact, rms) in CANDIDATES.items()
        ]
        meta = {"verdict": v.to_dict(), "candidates": candidates}
        store.write(CellResult(f"answer/{v.record}/0", "key", meta, {}))
    save_verdicts(folder, verdicts)


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory) -> Path:
    """A run in which everything is there. Not to be changed by a test."""
    return RunMaker(tmp_path_factory.mktemp("whole")).make()


@pytest.fixture
def maker_type():
    return RunMaker


@pytest.fixture
def sketchy(monkeypatch):
    """Figures are composed but not drawn, for tests of the text."""
    monkeypatch.setattr("bayesdamp.report.drawing._encode", lambda _: (b"<svg/>", b"png", b"webp"))


@pytest.fixture
def maker_of(tmp_path, sketchy):
    """Makers of other runs in the test's own folder; their figures are not drawn."""
    return functools.partial(RunMaker, tmp_path / "run")


@pytest.fixture
def maker(maker_of):
    """A small run, for a test to spoil."""
    return maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "viscous+coulomb"))
