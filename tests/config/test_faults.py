"""One clear line for everything that can be wrong in a study file."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.types import InputError
from tests.config.studies import FILE_SIGNAL, GOOD, SIGNAL, SYSTEM, fault


def swap(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def rig(extra: str = "", old: str = "", new: str = "") -> str:
    assert old in FILE_SIGNAL
    return "version = 1\n" + SYSTEM + FILE_SIGNAL.replace(old, new) + extra


FAULTS = {
    # the file as a whole
    "empty": ("", "is empty; a study starts with version = 1"),
    "syntax": ("version = 1\nname =\n", "line 2, column 7: is not TOML"),
    "no version": (SYSTEM + SIGNAL, "version: is missing; it must be 1"),
    "version 2": (swap("version = 1", "version = 2"), "version: is 2; it must be 1, the version of"),
    "top key": (swap("version = 1", "version = 1\nseeds = 3"), "seeds: unknown key; did you mean 'seed'?"),
    "top table": (GOOD + "[posteriors]\n", "posteriors: unknown key; did you mean 'posterior'?"),
    "seed": (swap("version = 1", "version = 1\nseed = -1"), "seed: is -1; it must be a whole number"),
    "name": (
        swap("version = 1", 'version = 1\nname = "a/b"'),
        "name: is 'a/b'; it must be at most 64 letters",
    ),
    "no signal": ("version = 1\n" + SYSTEM, "signal: is missing; a study has at least one [[signal]]"),
    "signal table": ("version = 1\n[signal]\nname = 'x'\n", "signal: is {'name': 'x'}; it must be tables"),
    "system list": ("version = 1\nsystem = 3\n" + SIGNAL, "system: is 3; it must be a table"),
    # [system]
    "no law": ("version = 1\n" + SIGNAL, "system.restoring: is missing; it must be one of duffing"),
    "law": (
        swap('"linear"', '"liner"'),
        "system.restoring: unknown restoring law 'liner'; did you mean 'linear'?",
    ),
    "law number": (swap('"linear"', "3"), "system.restoring: is 3; it must be a restoring law"),
    "system key": (swap("stiffness", "stifness"), "system.stifness: unknown key; did you mean 'stiffness'?"),
    "other law's": (
        swap("rest_angle = 0.0", "gravity = 1.0"),
        "system.gravity: unknown key; valid are restoring",
    ),
    "system text": (
        swap("20.0", '"fre"'),
        "system.stiffness: is 'fre'; it must be a number (known), \"free\"",
    ),
    "system inf": (swap("20.0", "inf"), "system.stiffness: is inf; it must be a number"),
    "epsilon": (swap("omega0", "epsilon = -1\nomega0"), "system.epsilon: is -1; it must be at least 0"),
    "amplitude": (
        swap("omega0", 'amplitude = "free"\nomega0'),
        "system.amplitude: is 'free'; it must be a pos",
    ),
    "noise_dof": (
        swap("omega0", "noise_dof = 0\nomega0"),
        "system.noise_dof: is 0; it must be a positive number",
    ),
    # priors
    "no prior": (
        swap("20.0", "{ mean = 1 }"),
        "system.stiffness: names no prior; it must be a table such as",
    ),
    "prior": (
        swap("20.0", '{ prior = "norml" }'),
        "stiffness.prior: unknown prior 'norml'; did you mean 'normal'?",
    ),
    "prior key": (
        swap("20.0", '{ prior = "normal", mean = 1, sdd = 1 }'),
        "system.stiffness.sdd: unknown key; did you mean 'sd'?",
    ),
    "prior missing": (
        swap("20.0", '{ prior = "normal", mean = 1 }'),
        "stiffness.sd: is missing; it must be a num",
    ),
    "prior sd": (
        swap("20.0", '{ prior = "normal", mean = 1, sd = 0 }'),
        "system.stiffness.sd: is 0; it must be a number above 0",
    ),
    "prior order": (
        swap("20.0", '{ prior = "uniform", low = 2, high = 1 }'),
        "system.stiffness: low (2) must be below high (1)",
    ),
    # [[signal]]
    "signal key": (GOOD + "fiel = 3\n", "signal[one].fiel: unknown key; did you mean 'file'?"),
    "no name": (swap('name = "one"\n', ""), "signal[1].name: is missing; it must be a name in quotes"),
    "bad name": (
        swap('"one"', '"on e"'),
        "signal[1].name: is 'on e'; it must be a name in quotes: at most 64",
    ),
    "name twice": (GOOD + SIGNAL, "signal: names the signal 'one' twice; once is enough"),
    "neither": (
        "version = 1\n" + SYSTEM + '[[signal]]\nname = "x"\n',
        "signal[x]: has neither simulate nor file",
    ),
    "both": (
        GOOD + 'file = "rig.csv"\n',
        "signal[one]: has both simulate and file; it must have one of the two",
    ),
    "own system": (GOOD + "system = { gravty = 3 }\n", "signal[one].system.gravty: unknown key"),
    "stray": (GOOD + "rate = 3.0\n", "signal[one].rate: belongs to a file; remove it here"),
    # simulate
    "simulate": (
        swap("duration", "durations"),
        "signal[one].simulate.durations: unknown key; did you mean 'duration'?",
    ),
    "no term": (swap("viscous = 0.05, ", ""), "signal[one].simulate: names no damping; give at least one of"),
    "negative": (swap("0.05", "-0.05"), "signal[one].simulate.viscous: is -0.05; it must be at least 0"),
    "no duration": (
        swap("duration = 10.0, ", ""),
        "simulate.duration: is missing; it must be the length of the record",
    ),
    "duration": (
        swap("10.0", "0"),
        "simulate.duration: is 0; it must be the length of the record in s, a positive",
    ),
    "samples": (
        swap("100", "100.0"),
        "simulate.samples: is 100.0; it must be a whole number from 10 to 10,000,000",
    ),
    "outliers": (
        swap("samples = 100", "samples = 100, outliers = 101"),
        "outliers: is 101; it must be at most samples",
    ),
    "simulated metres": (
        swap("samples = 100", 'samples = 100, unit = "m"').replace('"linear"', '"pendulum"'),
        "signal[one].simulate.unit: is 'm', a translation, which pendulum is not",
    ),
    "noise_sd": (swap("0.003", "-1"), "simulate.noise_sd: is -1; it must be at least 0"),
    "no noise_sd": (
        swap(", noise_sd = 0.003", ""),
        "signal[one].simulate: noise_sd is missing; a simulation needs",
    ),
    "free": (
        swap("20.0", '"free"'),
        "signal[one].simulate: stiffness is missing; a simulation needs the true value",
    ),
    "no epsilon": (
        swap("viscous", "coulomb"),
        "signal[one].simulate: epsilon is missing; a simulation needs",
    ),
    "no rest": (
        swap("20.0", "-20.0"),
        "signal[one].simulate: linear has no stable equilibrium within 10 rad",
    ),
    # a file
    "no file": (
        rig(old='"rig.csv"', new='"rg.csv"'),
        "signal[rig].file: 'rg.csv' is not there; paths start at",
    ),
    "angle": (rig(old='"phi"', new="0"), "signal[rig].angle: is 0; it must be the name of the recorded"),
    "no run": (rig("run = -1"), "signal[rig].run: is -1; it must be the number of one of the file's runs"),
    "no unit of time": (
        rig('time_unit = "weeks"'),
        "signal[rig].time_unit: is 'weeks'; it must be the unit of the times",
    ),
    "two clocks": (rig("rate = 3\n"), "signal[rig].rate: is given together with time; give one of the two"),
    "rate": (rig("", "time = 1", "rate = -1"), "signal[rig].rate: is -1; it must be the sampling rate in Hz"),
    "unit of another quantity": (
        rig('unit = "g"\nsystem = { restoring = "linear" }\n'),
        "signal[rig].unit: is 'g' with quantity 'angle'; it goes with quantity = \"acceleration\"",
    ),
    "forces of a sensor's unit": (
        rig('unit = "mV"\nsystem = { restoring = "linear", inertia = 2.0 }\n'),
        "signal[rig].unit: is 'mV', which has no forces; leave inertia out or use rad or m",
    ),
    "unit": (rig('unit = "degrees"\n'), "signal[rig].unit: is 'degrees'; it must be one of rad, mrad, deg"),
    "start": (rig('start = "early"\n'), "signal[rig].start: is 'early'; it must be a time in s, or \"auto\""),
    "stop": (rig("start = 3\nstop = 2.5\n"), "signal[rig].stop: is 2.5; it must be later than start (3)"),
    # [[sweep]]
    "sweep key": (
        GOOD + '[[sweep]]\nkey = "noise"\nvalues = [1]\n',
        "sweep[1].key: is 'noise', which is not a key of a signal; it must be like",
    ),
    "sweep inner": (
        GOOD + '[[sweep]]\nkey = "simulate.nois_sd"\nvalues = [1]\n',
        "simulate.nois_sd: unknown key; did you mean 'noise_sd'?",
    ),
    "sweep nothing": (
        GOOD + '[[sweep]]\nkey = "start"\nvalues = [1]\n',
        "sweep[1].key: is 'start', which no signal has",
    ),
    "sweep empty": (
        GOOD + '[[sweep]]\nkey = "system.stiffness"\nvalues = []\n',
        "sweep[1].values: is []; it must be a list of one or more values",
    ),
    "sweep twice": (
        GOOD + '[[sweep]]\nkey = "system.stiffness"\nvalues = [1.0, 1]\n',
        "sweep[1].values: holds a value twice",
    ),
    # the stages
    "estimator": (
        GOOD + '[estimators]\nuse = ["envelop"]\n',
        "unknown estimator 'envelop'; did you mean 'envelope'?",
    ),
    "estimator twice": (
        GOOD + '[estimators]\nuse = ["envelope", "envelope"]\n',
        "names the estimator 'envelope' twice",
    ),
    "stage": (
        GOOD + '[estimators]\nstages = ["first"]\n',
        "estimators.stages: is ['first']; it must be a list of",
    ),
    "options": (GOOD + "[estimators]\nenvelope = 3\n", "estimators.envelope: is 3; it must be a table"),
    "option table": (
        GOOD + "[estimators.envelop]\n",
        "estimators.envelop: unknown key; did you mean 'envelope'?",
    ),
    "model": (
        GOOD + '[models]\ncompare = ["coulom"]\n',
        "unknown damping term 'coulom'; did you mean 'coulomb'?",
    ),
    "model sum": (
        GOOD + '[models]\ncompare = ["viscous+viscous"]\n',
        "models.compare: is 'viscous+viscous'; it must be a sum of different terms",
    ),
    "model twice": (
        GOOD + '[models]\ncompare = ["viscous+coulomb", "coulomb+viscous"]\n',
        "models.compare: names the model 'viscous+coulomb' twice",
    ),
    "no model": (
        GOOD + "[models]\ncompare = []\n",
        'models.compare: is []; it must be "all" or a list of one',
    ),
    "term prior": (
        GOOD + "[models]\nprior = { viscous = 3 }\n",
        "models.prior.viscous: is 3; it must be a table",
    ),
    "negative term": (
        GOOD + '[models]\nprior = { viscous = { prior = "normal", mean = 1, sd = 1 } }\n',
        "models.prior.viscous: is normal(mean 1, sd 1), which allows values below zero; it must be",
    ),
    "negative noise": (
        swap("omega0", 'noise_sd = { prior = "uniform", low = -1, high = 1 }\nomega0'),
        "system.noise_sd: is uniform(low -1, high 1), which allows values below zero",
    ),
    "sampler": (GOOD + '[posterior]\nsamplers = ["nut"]\n', "unknown sampler 'nut'; did you mean 'nuts'?"),
    "posterior noise": (
        GOOD + '[posterior]\nnoise = "gausian"\n',
        "unknown noise model 'gausian'; did you mean",
    ),
    "chains": (
        GOOD + "[posterior]\nchains = 1\n",
        "posterior.chains: is 1; it must be a whole number from 2 to 1000",
    ),
    "evidence": (GOOD + '[evidence]\nmethods = ["importanc"]\n', "evidence method 'importanc'; did you mean"),
    "referee": (
        GOOD + '[evidence]\nreferee = "often"\n',
        "evidence.referee: is 'often'; it must be \"auto\"",
    ),
}


@pytest.mark.parametrize(("text", "expected"), FAULTS.values(), ids=FAULTS)
def test_every_fault_is_one_line_that_names_the_key(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in fault(tmp_path, text)


def test_files_that_are_no_study(tmp_path: Path) -> None:
    for path in (tmp_path / "none.toml", tmp_path):
        with pytest.raises(InputError, match=r"^[^\n]*; give [^\n]*$"):
            load_study(path)
    latin = tmp_path / "latin.toml"
    latin.write_bytes("name = 'Müller'".encode("latin-1"))
    with pytest.raises(InputError, match="is not text in UTF-8"):
        load_study(latin)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (
            'compare = ["viscuos"]',
            "signal[one].compare: unknown damping term 'viscuos'; did you mean 'viscous'?",
        ),
        ("compare = []", "signal[one].compare"),
        (
            'estimate = ["viscous+coulomb"]',
            "signal[one].estimate: names viscous+coulomb, which this signal does",
        ),
        ('compare = ["coulomb", "coulomb"]', "signal[one].compare"),
    ],
)
def test_wrong_models_of_a_signal(tmp_path: Path, line: str, expected: str) -> None:
    assert fault(tmp_path, f"version = 1\n{SYSTEM}{SIGNAL}{line}\n").startswith(expected)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "published: is 'printed.csv', which cannot be read"),
        ("estimator,signal\nenvelope,one\n", "published: is 'printed.csv', which has no column error_pct"),
        (
            "estimator,signal,error_pct,time\nenvelop,one,1,\n",
            "published: line 2 of printed.csv: unknown estimator",
        ),
        (
            "estimator,signal,error_pct,time\nenvelope,two,1,\n",
            "published: line 2 of printed.csv: unknown signal",
        ),
    ],
)
def test_wrong_published_figures(tmp_path: Path, content: str | None, expected: str) -> None:
    if content is not None:
        (tmp_path / "printed.csv").write_text(content)
    text = GOOD.replace("version = 1", 'version = 1\npublished = "printed.csv"')
    assert fault(tmp_path, text).startswith(expected)
