"""A call that cannot be meant is one line of InputError that names what is wrong and what would be right."""

from __future__ import annotations

import inspect
import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.calls import checked_call
from tests.interface.problems import not_refused

ANY: Any = bd
"""The package without its types, which would refuse these calls."""
MODEL = bd.Model("viscous")
T = np.linspace(0.0, 6.0, 150)
Y = 0.3 * np.exp(-0.05 * T) * np.cos(4.47 * T)
WRONG: dict[str, Callable[[], object]] = {
    "read: path is int; it must be a path": lambda: ANY.read(3),
    "read: unknown argument 'vlaue'; did you mean 'value'": lambda: ANY.read("rig.csv", vlaue=2),
    "read: rate is str; it must be a number, in Hz": lambda: ANY.read("rig.csv", rate="100"),
    "run_study: unknown argument 'worker'; did you mean 'workers'": lambda: ANY.run_study({}, "x", worker=2),
    "features: signal is ndarray; it must be a Signal": lambda: ANY.features(Y),
    "signal: give times and values, signal(t, y), or values alone": lambda: ANY.signal(T),
    "Model: missing a required argument: 'damping'": lambda: ANY.Model(),
    "fit: signal is str; it must be a Signal": lambda: ANY.fit("rig.csv", MODEL),
    "simulate: missing a required argument: 'duration'": lambda: ANY.simulate({}, stiffnes=20.0),
    "model is str; it must be a Model": lambda: ANY.fit(bd.signal(T, Y), "viscous"),
    "compare: give one signal": lambda: ANY.compare(3),
    "signal: give times or rate, not both": lambda: ANY.signal(T, Y, rate=25.0),
    "signal: rate is 0; it must be a number of Hz": lambda: ANY.signal(Y, rate=0),
    "plot: unknown argument 'axes'; did you mean 'ax'": lambda: bd.signal(T, Y).plot(axes=None),  # type: ignore[call-arg]
    "save: missing a required argument: 'path'": lambda: MODEL.save(),  # type: ignore[call-arg]
    "load: unknown argument 'recrd'; did you mean 'record'": lambda: ANY.Verdict.load("x", recrd="a"),
}


def test_it_is_one_line() -> None:
    assert not_refused((call, "^" + re.escape(said)) for said, call in WRONG.items()) == []


def test_what_is_meant_goes_through() -> None:
    """The negative control: defaults of another type, keywords of any name, and faults inside are none of these."""

    def asked(path: str, rate: float | None = None, **more: object) -> object:
        if rate == 0:
            raise TypeError("a fault inside")
        return path, rate, more

    called = checked_call(asked, "asked")
    assert called("x", rate=None, other=1) == ("x", None, {"other": 1})
    with pytest.raises(TypeError, match="a fault inside"):
        called("x", 0)


def test_signatures_stay_and_processes_find_them() -> None:
    assert list(inspect.signature(bd.fit).parameters)[:2] == ["signal", "model"]
    assert list(inspect.signature(bd.Model).parameters)[:2] == ["damping", "restoring"]
    assert pickle.loads(pickle.dumps(bd.compare)) is bd.compare
    assert pickle.loads(pickle.dumps(MODEL)) == MODEL
