"""Without its package an estimator refuses, and all others work."""

import subprocess
import sys
from pathlib import Path

import pytest

from bayesdamp.estimators import names_for_all
from bayesdamp.estimators.shared import optional_package

NEEDS = {
    "pinn": ["torch"],
    "neural_ode": ["torch", "torchdiffeq"],
    "rnn": ["torch"],
    "sindy": ["pysindy"],
    "symbolic_regression": ["pyoperon"],
    "topological": ["gudhi"],
}
PACKAGES = sorted({package for packages in NEEDS.values() for package in packages})
ROOT = Path(__file__).resolve().parents[2]


def test_a_package_that_lacks_another_is_an_error(tmp_path, monkeypatch):
    """Negative control: the package is installed, so that the error must be shown."""
    (tmp_path / "half_installed.py").write_text("import a_package_that_nobody_has\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="a_package_that_nobody_has"):
        optional_package("half_installed")


PROGRAM = """
import sys

class Missing:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in PACKAGES:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Missing)
from bayesdamp.estimators import ESTIMATORS, names_for_all, parse_options, run
from bayesdamp.estimators.shared import table
from tests.estimators.truths import pendulum

table([ESTIMATORS.get(name) for name in names_for_all()], ["viscous", "power"])
signal, problem = pendulum({"zeta": 0.05}, samples=500)
for name in names_for_all():
    options = {"generations": 2} if name == "genetic" else None
    parse_options(name, options)
    print(name, run(name, signal, problem, options=options, stages=["initial"], seed=1)[0].outcome)
"""


def test_estimators_without_their_package_refuse_and_others_run():
    """Names, options and the table of terms need none of the packages."""
    program = f"PACKAGES = {PACKAGES}\n{PROGRAM}"
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, cwd=ROOT)
    assert process.returncode == 0, process.stderr
    outcomes = dict(line.split(" ", 1) for line in process.stdout.splitlines())
    assert set(outcomes) == set(names_for_all())
    for name, outcome in outcomes.items():
        package = NEEDS.get(name, [""])[0]
        missing = f'this estimator needs {package}; install it with: pip install "bayesdamp[paper]"'
        assert outcome == (missing if package else "ok")
