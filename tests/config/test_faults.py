# ruff: noqa: E501
"""The error message of everything that can be wrong in a study file."""

from pathlib import Path

import pytest

from tests.config.studies import FILE_SIGNAL, GOOD, SIGNAL, SYSTEM, VARIANT, fault


def swap(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new)


def rig(extra: str = "", old: str = "", new: str = "") -> str:
    assert old in FILE_SIGNAL
    return "version = 1\n" + SYSTEM + FILE_SIGNAL.replace(old, new) + extra


def sweep(key: str, values: str) -> str:
    return f'{GOOD}[[sweep]]\nkey = "{key}"\nvalues = {values}\n'


PRINTED = 'version = 1\npublished = "printed.csv"'
FAULTS = {
    # the file as a whole
    "empty": ("", "is empty; a study starts with version = 1"),
    "no version": (SYSTEM + SIGNAL, "version: is missing; it must be 1"),
    "top key": (swap("version = 1", "version = 1\nseeds = 3"), "seeds: unknown key; did you mean 'seed'?"),
    "no signal": ("version = 1\n" + SYSTEM, "signal: is missing; a study has at least one [[signal]]"),
    # [system]
    "no law": ("version = 1\n" + SIGNAL, "system.restoring: is missing; it must be one of duffing"),
    "law": (swap('"linear"', '"liner"'), "system.restoring: unknown restoring law 'liner'; did you mean 'linear'?"),
    "other law's": (swap("rest_angle = 0.0", "gravity = 1.0"), "system.gravity: unknown key; valid are restoring"),
    "system text": (swap("20.0", '"fre"'), "system.stiffness: is 'fre'; it must be a number (known), \"free\""),
    # priors
    "no prior": (swap("20.0", "{ mean = 1 }"), "system.stiffness: does not state the type of the prior; the value must be"),
    "prior missing": (swap("20.0", '{ prior = "normal", mean = 1 }'), "stiffness.sd: is missing; it must be a num"),
    "negative noise": (swap("omega0", 'noise_sd = { prior = "uniform", low = -1, high = 1 }\nomega0'), "system.noise_sd: is uniform(low -1, high 1), which allows values below zero"),
    # [[signal]]
    "signal key": (GOOD + "fiel = 3\n", "signal[one].fiel: unknown key; did you mean 'file'?"),
    "neither": ("version = 1\n" + SYSTEM + '[[signal]]\nname = "x"\n', "signal[x]: has neither simulate nor file"),
    "both": (GOOD + 'file = "rig.csv"\n', "signal[one]: has both simulate and file; it must have one of the two"),
    "stray": (GOOD + "rate = 3.0\n", "signal[one].rate: is for a record from a file; remove it here"),
    "own models": (GOOD + 'compare = ["viscuos"]\n', "signal[one].compare: unknown damping term 'viscuos'; did you mean 'viscous'?"),
    "own estimate": (GOOD + 'estimate = ["viscous+coulomb"]\n', "signal[one].estimate: contains viscous+coulomb, which this signal does"),
    # simulate
    "simulate": (swap("duration", "durations"), "signal[one].simulate.durations: unknown key; did you mean 'duration'?"),
    "no term": (swap("viscous = 0.05, ", ""), "signal[one].simulate: has no damping term; give at least one of"),
    "negative": (swap("0.05", "-0.05"), "signal[one].simulate.viscous: is -0.05; it must be a number of at least 0"),
    "samples": (swap("100", "100.0"), "simulate.samples: is 100.0; it must be a whole number from 10 to 10,000,000"),
    "simulated metres": (swap("samples = 100", 'samples = 100, unit = "m"').replace('"linear"', '"pendulum"'), "signal[one].simulate.unit: is 'm', a translation, but the restoring law pendulum needs an angle"),
    "no noise_sd": (swap(", noise_sd = 0.003", ""), "signal[one].simulate: noise_sd is missing; a simulation needs"),
    "free": (swap("20.0", '"free"'), "signal[one].simulate: stiffness is missing; a simulation needs the true value"),
    "no rest": (swap("viscous", "stiffness = -20.0, viscous"), "signal[one].simulate: the law linear has no stable equilibrium within 10 of 0.3 rad; choose"),
    "no rest under another law": (swap('"linear"', '"duffing"').replace("20.0", "-20.0").replace("rest_angle = 0.0", "rest_angle = 0.0\ncubic = 50.0") + '[models]\nrestoring = ["pendulum"]\n', "signal[one].system: stiffness = -20: it must be above 0 under the law pendulum"),
    # a file
    "no file": (rig(old='"rig.csv"', new='"rg.csv"'), "signal[rig].file: 'rg.csv' does not exist; paths are relative to"),
    "forces of a sensor's unit": (rig('unit = "mV"\nsystem = { restoring = "linear", inertia = 2.0 }\n'), "signal[rig].unit: is 'mV', a unit in which inertia has no meaning; remove inertia, or use rad or m"),
    "unit": (rig('unit = "degrees"\n'), "signal[rig].unit: unknown unit 'degrees'; it must be one of rad, mrad, urad, deg"),
    # [[sweep]]
    "sweep key": (sweep("noise", "[1]"), "sweep[1].key: is 'noise', which is not a key of a signal; it must be like"),
    "sweep nothing": (sweep("start", "[1]"), "sweep[1].key: is 'start', which no signal has"),
    "sweep twice": (sweep("system.stiffness", "[1.0, 1]"), "sweep[1].values: repeats a value"),
    # the stages
    "options": (GOOD + "[estimators]\nenvelope = 3\n", "estimators.envelope: is 3; it must be a table"),
    "repeats": (GOOD + "[estimators]\nrepeats = { envelop = 2 }\n", "estimators.repeats.envelop: unknown key; did you mean 'envelope'?"),
    "variant of": (GOOD + VARIANT.replace('"sindy"\nswitch', '"sindi"\nswitch'), "estimators.by_sign.variant_of: unknown estimator 'sindi'"),
    "variant's name": (GOOD + VARIANT.replace("[estimators.by_sign]", "[estimators.koopman]"), "estimators.koopman: is an estimator's name"),
    "variant of nothing": (GOOD + VARIANT.replace('variant_of = "sindy"\n', ""), "by_sign"),
    "model sum": (GOOD + '[models]\ncompare = ["viscous+viscous"]\n', "models.compare: is 'viscous+viscous'; it must be a sum of different terms"),
    "another law": (GOOD + '[models]\nrestoring = ["linear", "dufing"]\n', "did you mean 'duffing'"),
    "another law's": (GOOD.replace("omega0", "cubic = 1.0\nomega0") + '[models]\nrestoring = ["linear", "pendulum"]\n', "cubic"),
    "sampler": (GOOD + '[posterior]\nsamplers = ["nut"]\n', "unknown sampler 'nut'; did you mean 'nuts'?"),
}  # fmt: skip
"""A study, and a part of the line that names the key."""


@pytest.mark.parametrize(("text", "expected"), FAULTS.values(), ids=FAULTS)
def test_every_fault_is_one_line_that_names_the_key(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in fault(tmp_path, text)


def test_wrong_published_figures_are_refused(tmp_path: Path) -> None:
    for content, expected in (
        (None, "is 'printed.csv', which cannot be read"),
        (
            "estimator,signal\nenvelope,one\n",
            "is 'printed.csv', which has no column error_pct; its columns must be",
        ),
        (
            "estimator,signal,error_pct,time\nenvelop,one,1,\n",
            "contains the unknown estimator 'envelop'; did you mean 'envelope'?",
        ),
        (
            "estimator,signal,error_pct,time\nenvelope,two,1,\n",
            "contains the unknown signal 'two'; valid are one",
        ),
    ):
        if content is not None:
            (tmp_path / "printed.csv").write_text(content)
        assert fault(tmp_path, swap("version = 1", PRINTED)).startswith(f"published: {expected}")
