"""Folders of runs with a measured and a simulated signal, written without computing anything."""

import functools
import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.store.files import POPULATION, TABLES, write_json, write_table
from bayesdamp.store.results import ComparedCandidate, Store, TaskResult
from bayesdamp.types import FeatureValues
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

LAW = "horizontal_pendulum"
MODELS = ("viscous", "coulomb", "quadratic", "viscous+coulomb")
OWN = {"viscous": ("zeta", "1/s"), "coulomb": ("mu_c", "rad/s²"), "quadratic": ("mu_q", "1/rad")}
SIZE = {
    "bench": {"zeta": (0.1292, 0.0005), "mu_c": (0.1340, 0.003), "mu_q": (0.021, 0.0004)},
    "sim": {"zeta": (0.0501, 0.0002), "mu_c": (0.031, 0.0006), "mu_q": (0.092, 0.002)},
}
SHARED = {
    "bench": {"stiffness": (491.2, 0.4, "1/s²"), "noise_sd": (0.0021, 2e-5, "rad")},
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
    "sindy": {"selected": ["2θ̇", "θ"], "coefficients": [0.0502, -20.1]},
    "symbolic_regression": {"chosen": "f(v) = 0.1·v"},
    "neural_ode": {"velocity": [-1.0, 0.0, 1.0], "force": [-0.11, 0.0, 0.1], "law": [-0.1, 0.0, 0.1]},
}
"""What some methods store besides their estimates."""

RATIOS = (
    DampingRatio(0.51, "rad", 0.006512, 2.1e-5, 4.7e-5, 0.006411, 0.006618),
    DampingRatio(0.22, "rad", 0.007324, 2.6e-5, 5.9e-5, 0.007203, 0.007456),
    DampingRatio(0.073, "rad", 0.011283, 7.3e-5, 1.7e-4, 0.010922, 0.011651),
)
VERDICTS = (
    Verdict(
        "bench", Grade.EXACT, True, "viscous+coulomb", 0.9783, (Rival("viscous", 0.0217),), LAW,
        damping_ratio=RATIOS, frequency=Interval(3.9903, 3.9889, 3.9917, "Hz"), unexplained_pct=0.83,
        deviation=Interval(0.0112, 0.0031, 0.0264),
        energy=(Share("viscous", 0.612, 0.583, 0.644, 1.0), Share("coulomb", 0.388, 0.356, 0.417, 0.98)),
        other_forms=(Bound("quadratic", 0.0087),),
        coefficients=(Coefficient("zeta", 0.12932, 2.7e-4, 6.1e-4, 0.12801, 0.13064, "1/s"),
                      Coefficient("mu_c", 0.13417, 1.3e-3, 2.9e-3, 0.12791, 0.14038, "rad/s²")),
    ),
    Verdict(
        "sim", Grade.APPROXIMATE, False, "viscous", 0.8134, (Rival("viscous+coulomb", 0.1523),), LAW,
        damping_ratio=RATIOS[1:], frequency=Interval(0.71265, 0.70912, 0.71618, "Hz"), unexplained_pct=1.27,
        frequency_at=FrequencyAt(0.073, "rad", 0.70116, 0.70093, 0.70139), deviation=Interval(0.0423, 0.0112, 0.0861),
        energy=(Share("viscous", 0.887, 0.711, 0.973, 0.99), Share("coulomb", 0.113, 0.027, 0.289, 0.18)),
        coefficients=(Coefficient("zeta", 0.05017, 1.2e-4, 3.1e-4, 0.04951, 0.05082, "1/s"),),
    ),
    Verdict(
        "sim-2", Grade.EXACT, True, "viscous", 0.9871, (Rival("viscous+coulomb", 0.0129),), LAW,
        damping_ratio=RATIOS[:1], frequency=Interval(0.71265, 0.71193, 0.71618, "Hz"), unexplained_pct=0.41,
    ),
)  # fmt: skip
QUANTILES = {"q2.5": 0.025, "q25": 0.25, "median": 0.5, "q75": 0.75, "q97.5": 0.975}
CANDIDATES = {"viscous": (-812.34, -1204.6, 0.03127), "viscous+coulomb": (321.7, 298.2, 0.00213)}
"""Log evidence, log evidence under exact laws and rms residual in rad."""
EPSILON = 0.0123
"""The width of the sign change of friction in all answers, in rad/s."""
OF_SPECIMENS = dict(zip(POPULATION, ("viscous", LAW, "zeta", "1/s", 4, 5, 3, 6, 1.4, 0.8, 2.7, 2.2, 9.1)))
"""A row of population.csv."""


def trajectory(kind: str, t: np.ndarray) -> np.ndarray:
    """Return a viscous decay at times in s, in rad."""
    start, rate, frequency = (0.5, 0.14, 25.1) if kind == "bench" else (0.3, 0.053, 4.47)
    return start * np.exp(-rate * t) * np.cos(frequency * t)


class RunMaker:
    """Writes the folder of a run; `tables` are the rows of its tables, by file name."""

    def __init__(self, folder: Path, signals=("bench", "sim"), repeats=None, models=MODELS) -> None:
        self.folder, self.store, self.rng = folder, Store(folder), np.random.default_rng(7)
        self.signals, self.models = list(signals), models
        self.repeats = repeats or {"bench": 1, "sim": 2}
        self.tables: dict[str, list[dict]] = {name: [] for name in TABLES}

    def kind(self, signal: str) -> str:
        return "bench" if signal.startswith("bench") else "sim"

    def make(self) -> Path:
        for signal in self.signals:
            for repeat in range(self.repeats.get(signal, 1)):
                t, y = self.signal(signal, repeat)
                for model in self.models:
                    place = {"signal": signal, "repeat": repeat, "model": model, "restoring": LAW}
                    path, kind = f"{signal}/{repeat}/{model}", self.kind(signal)
                    self.mode(place, path, kind, t, y)
                    self.estimates(place, path, kind)
                    self.posterior(place, path, kind)
                    self.evidence(place, path, kind)
        for name, rows in self.tables.items():
            write_table(self.folder / name, TABLES[name], rows)
        write_json(self.folder / "run.json", self.info())
        return self.folder

    def put(self, name: str, meta: dict, arrays: dict, outcome: str = "ok") -> None:
        self.store.write(TaskResult(name, "key", meta, arrays, outcome, float(self.rng.exponential(2.0))))

    def signal(self, signal: str, repeat: int) -> tuple[np.ndarray, np.ndarray]:
        kind = self.kind(signal)
        t = np.arange(5000) / 260.0 if kind == "bench" else np.linspace(0, 10, 1000)
        y = trajectory(kind, t) + self.rng.normal(0, 0.003, t.size)
        period = 0.25 if kind == "bench" else 1.405
        features = asdict(FeatureValues(0.0, 0.3, 0.1, 4.5, period, 9.0, 140.0, 0.001))
        meta: dict = {"features": features, "known": {"epsilon": 0.05}}
        arrays = {"t": t, "y": y}
        if kind == "bench":  # deflected and at rest before its release, and at rest at the end
            raw = np.concatenate([np.full(520, y[0]), y, np.full(1300, 0.0088)])
            arrays |= {"raw_t": np.arange(raw.size) / 260.0, "raw_y": raw}
        self.put(f"signal/{signal}/{repeat}", meta, arrays)
        return t, y

    def mode(self, place: dict, path: str, kind: str, t: np.ndarray, y: np.ndarray) -> None:
        fit = trajectory(kind, t)
        residual = y - fit
        sizes = {name: SIZE[kind][name] for name, _ in (OWN[term] for term in place["model"].split("+"))}
        values, sds = ({name: pair[i] for name, pair in sizes.items()} for i in (0, 1))
        meta = {"values": values, "sd": sds, "log_posterior": 1234.5}
        arrays = {"t": t, "fit": fit, "residual": residual, "whitened": residual / residual.std()}
        self.put(f"mode/{path}", meta, arrays | {"autocorrelation": 0.94 ** np.arange(26)})
        factor, unit = (180 / math.pi, "deg") if kind == "bench" else (1.0, "rad")
        is_good = LOG_BAYES[kind][place["model"]] > -2
        self.tables["fits.csv"].append({
            **place, "rms": residual.std() * factor, "rms_unit": unit,
            "residual_autocorrelation": 0.235, "window_spread": 4.1 if kind == "bench" else 0.6,
            "predictive_p": (0.003 if kind == "bench" else 0.41) if is_good else 0.0,
            "verdict": f"the residual is {'as small as' if is_good else 'far above'} the noise",
        })  # fmt: skip

    def estimates(self, place: dict, path: str, kind: str) -> None:
        rows, repeats = self.tables["estimates.csv"], place["repeat"] + 1
        for i, method in enumerate(METHODS, 1):
            of_method = {**place, "estimator": method, "outcome": "ok"}
            if method == "envelope" and "+" in place["model"]:
                reason = "refuses: the envelope of a sum of dampings has no closed form here"
                rows.append({**of_method, "stage": "initial", "seconds": 0.0, "outcome": reason})
                continue
            for stage, error in (("initial", 30), ("refined", 0.2)):
                for name, unit in (OWN[term] for term in place["model"].split("+")):
                    value, sd = SIZE[kind][name]
                    value = 0.0 if kind == "sim" and name == "mu_c" and "+" in place["model"] else value
                    value += sd * error * self.rng.normal()
                    truth = TRUTH[name] if kind == "sim" else math.nan
                    rows.append({
                        **of_method, "stage": stage, "parameter": name, "unit": unit, "value": value, "truth": truth,
                        "error_pct": 100 * (value / truth - 1) if truth else math.nan,
                        "stderr": sd if stage == "refined" else math.nan,
                        "evaluations": 300 * i * repeats, "seconds": 0.3 * i * repeats,
                    })  # fmt: skip
            of_both = {"estimator": method, "details": DETAILS.get(method, {})}
            stages = [{**of_both, "stage": "initial"}, {**of_both, "stage": "refined", "details": {}}]
            self.put(f"estimate/{path}/{method}", {"stages": stages}, {})

    def posterior(self, place: dict, path: str, kind: str) -> None:
        own = [OWN[term] for term in place["model"].split("+")]
        sizes = [(n, u, *SIZE[kind][n]) for n, u in own]
        sizes += [(n, u, v, s) for n, (v, s, u) in SHARED[kind].items()]
        names, units, mean, sd = (list(column) for column in zip(*sizes))
        if kind == "sim" and "mu_c" in names:
            mean[names.index("mu_c")] = 0.0
        for sampler in ("nuts", "emcee"):
            draws = np.array(mean) + np.array(sd) * self.rng.normal(size=(4, 1000, len(names)))
            draws[..., : len(own)] = np.abs(draws[..., : len(own)])
            is_slow = sampler == "emcee" and place["model"] == "quadratic"
            outcome = "not converged: R̂ of stiffness is 1.034, above 1.01" if is_slow else "ok"
            stored = {"sampler": sampler, "names": names, "draws": [], "log_likelihood": []}
            without = {"decrement": 3, "half_life": 7} if is_slow else {}
            meta = {"posterior": stored, "units": dict(zip(names, units)), "without": without}
            self.put(f"posterior/{path}/{sampler}", meta, {"draws": draws}, outcome)
            flat = draws.reshape(-1, len(names))
            derived = ("natural_frequency", "rad/s", np.sqrt(20 + 0.001 * self.rng.normal(size=len(flat))))
            for name, unit, x in (*zip(names, units, flat.T), derived):
                quantiles = dict(zip(QUANTILES, np.quantile(x, list(QUANTILES.values()))))
                self.tables["posteriors.csv"].append({
                    **place, **quantiles, "sampler": sampler, "parameter": name, "unit": unit, "mean": x.mean(),
                    "sd": x.std(), "hdi_low": quantiles["q2.5"], "hdi_high": quantiles["q97.5"],
                    "ess_bulk": 3900.0 if sampler == "nuts" else 1200.0, "ess_tail": 2800.0, "seconds": 4.0,
                    "rhat": 1.034 if is_slow and name == "stiffness" else 1.001, "outcome": outcome,
                    "divergences": 0 if sampler == "nuts" else None,
                })  # fmt: skip

    def evidence(self, place: dict, path: str, kind: str) -> None:
        logs = {m: LOG_BAYES[kind][m] for m in self.models}
        own, total = logs[place["model"]], sum(math.exp(v) for v in logs.values())
        for method, shift, diagnostic in (("importance", 0.0, "Pareto k 0.21"), ("bridge", 0.02, "")):
            self.tables["evidence.csv"].append({
                **place, "method": method, "log_evidence": 29362.41 + own + shift, "stderr": 0.008, "outcome": "ok",
                "log_bayes_factor": own - max(logs.values()), "probability": math.exp(own) / total,
                "diagnostic": diagnostic,
            })  # fmt: skip
            self.put(f"evidence/{path}/{method}", {}, {})

    def info(self) -> dict:
        note = "The velocity ε, within which friction changes its sign, was not given; it is assumed."
        cut = {"start": 2.0, "stop": 21.23, "epsilon_note": note}
        about = {
            "bench": {"notes": ["Cut."], "unit": "deg", "quantity": "angle", "simulated": False, **cut},
            "sim": {"notes": ["Simulated."], "unit": "rad", "quantity": "angle", "simulated": True},
        }
        system = {"restoring": LAW, "known": {"stiffness": 20.0}, "free": {"noise_sd": None}}
        study = {
            "signals": [{"name": name, "system": system} for name in self.signals],
            "estimators": {"use": list(METHODS), "stages": ["initial", "refined"]},
            "models": {"compare": list(self.models)},
            "posterior": {"samplers": ["nuts", "emcee"], "noise": "correlated"},
            "evidence": {"methods": ["importance", "bridge"], "referee": "auto"},
        }
        priors = {m: {OWN[term][0]: "halfnormal(scale 0.45)" for term in m.split("+")} for m in self.models}
        return {
            "name": "two pendulums",
            "study": study,
            "seed": 20260101,
            "versions": {"numpy": "2.1.0"},
            "machine": {"system": "Linux", "cpus": 2},
            "inputs": {"bench.txt": "ab" * 32},
            "seconds": {name: self.store.read(name).seconds for name in self.store.names()},
            "signals": {name: about[self.kind(name)] for name in self.signals},
            "priors": dict.fromkeys(self.signals, priors),
            "models": list(self.models),
        }


def write_answers(folder: Path) -> None:
    """Write VERDICTS as the answers on their records, with sentences by the current program."""
    store = Store(folder)
    verdicts = [replace(v, sentence=sentence(v)) for v in VERDICTS]
    for v in verdicts:
        candidates = [asdict(ComparedCandidate(n, v.restoring, *each)) for n, each in CANDIDATES.items()]
        meta = {"verdict": v.to_dict(), "candidates": candidates, "epsilon": EPSILON}
        store.write(TaskResult(f"answer/{v.record}/0", "key", meta, {}))
    save_verdicts(folder, verdicts)
    write_table(folder / "population.csv", POPULATION, [OF_SPECIMENS])


@pytest.fixture(scope="session")
def whole_run(tmp_path_factory) -> Path:
    """A run with all kinds of results. Tests must not change it."""
    return RunMaker(tmp_path_factory.mktemp("whole")).make()


@pytest.fixture
def sketchy(monkeypatch):
    """Figures are composed but not rendered, for tests of the text."""
    monkeypatch.setattr("bayesdamp.report.drawing._svg", lambda _: b"<svg/>")


@pytest.fixture
def maker_of(tmp_path, sketchy):
    """Makers of runs in the test's own folder; their figures are not rendered."""
    return functools.partial(RunMaker, tmp_path / "run")


@pytest.fixture
def maker(maker_of):
    """The maker of a small run that a test may damage."""
    return maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "viscous+coulomb"))
