"""A wrong call raises an InputError of one line that names what is wrong and what is valid."""

import inspect
import pickle
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.calls import checked_call
from tests.interface.problems import MODEL, TIMES, not_refused, record

ANY: Any = bd
"""The package without its types: type checkers would reject these calls."""
REFUSED: dict[str, Callable[[], object]] = {
    "read: path is int; it must be a path": lambda: ANY.read(3),
    "read: unknown argument 'vlaue'; did you mean 'value'": lambda: ANY.read("rig.csv", vlaue=2),
    "features: signal is ndarray; it must be a Signal": lambda: ANY.features(TIMES),
    "signal: give times and values as signal(t, y), or signal(y, rate=HERTZ)": lambda: ANY.signal(TIMES),
    "Model: missing a required argument: 'damping'": lambda: ANY.Model(),
    "fit: model is str; it must be a Model": lambda: ANY.fit(record(), "viscous"),
    "compare: give one signal": lambda: ANY.compare(3),
    "signal: give times or rate, not both": lambda: ANY.signal(TIMES, TIMES, rate=25.0),
    "signal: rate is 0; it must be a number of Hz": lambda: ANY.signal(TIMES, rate=0),
    "simulate: seed is -1; it must be a whole number": lambda: ANY.simulate(
        {}, duration=1, samples=9, seed=-1
    ),
    "compare: amplitudes is float; it must be a list": lambda: ANY.compare(record(), amplitudes=0.2),
    "signal: stop is NoneType; it must be a number of seconds": lambda: ANY.signal(TIMES, TIMES, stop=None),
    "fit.start.zeta: is nan; it must be a number": lambda: ANY.fit(record(), MODEL, start={"zeta": np.nan}),
    "load: unknown argument 'recrd'; did you mean 'record'": lambda: ANY.Verdict.load("x", recrd="a"),
}


def test_a_wrong_call_is_refused_in_one_line() -> None:
    assert not_refused((call, "^" + re.escape(line)) for line, call in REFUSED.items()) == []


def test_a_right_call_is_not_refused() -> None:
    """A default of another type, keywords of any name, and a TypeError of the function itself."""

    def function(path: str, rate: float | None = None, **more: object) -> object:
        if rate == 0:
            raise TypeError("a fault inside")
        return path, rate, more

    checked = checked_call(function, "function")
    assert checked("x", rate=None, other=1) == ("x", None, {"other": 1})
    with pytest.raises(TypeError, match="a fault inside"):
        checked("x", 0)


def test_checked_functions_have_their_signature_and_can_be_pickled() -> None:
    assert list(inspect.signature(bd.fit).parameters)[:2] == ["signal", "model"]
    assert list(inspect.signature(bd.Model).parameters)[:2] == ["damping", "restoring"]
    assert pickle.loads(pickle.dumps(bd.compare)) is bd.compare
    assert pickle.loads(pickle.dumps(MODEL)) == MODEL
