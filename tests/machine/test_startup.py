"""What is said at first loads no compiler, and a fit no JAX."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator

ROOT = Path(__file__).parents[2]
HEAVY = (
    "jax",
    "numba",
    "torch",
    "pandas",
    "matplotlib",
    "scipy.optimize",
    "scipy.interpolate",
    "scipy.signal",
)
AFTER = "\nimport sys\nprint('loaded:' + ','.join(n for n in {heavy!r} if n in sys.modules))"


def loaded(source: str, heavy: tuple[str, ...] = HEAVY) -> set[str]:
    """Which of the heavy modules a new process has loaded after this source."""
    code = source + AFTER.format(heavy=heavy)
    return set(filter(None, said(code).rpartition("loaded:")[2].strip().split(",")))


def said(code: str) -> str:
    """What a new process prints, whose environment says nothing of JAX."""
    own = {k: v for k, v in os.environ.items() if k != "JAX_ENABLE_X64"}
    command = [sys.executable, "-c", code]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True, env=own).stdout


def test_importing_loads_nothing_heavy() -> None:
    assert loaded("import bayesdamp", (*HEAVY, "numpy", "scipy", "xarray")) == set()


@pytest.mark.parametrize("first", ["import bayesdamp, jax", "import jax, bayesdamp", "import jax"])
def test_arrays_are_double_with_the_package_whichever_is_imported_first(first: str) -> None:
    """The negative control: without the package they are not."""
    kind = "float64" if "bayesdamp" in first else "float32"
    assert said(f"{first}; print(jax.numpy.ones(2).dtype)") == f"{kind}\n"


def command(*words: str) -> str:
    """The source that runs a command."""
    return f"from bayesdamp.cli import main\nassert main({list(words)!r}) == 0"


def test_a_study_is_checked_without_a_compiler() -> None:
    assert loaded(command("check", "studies/quickstart.toml")) == set()


def test_a_worker_begins_without_a_compiler_or_a_terminal() -> None:
    assert loaded("import bayesdamp.pipeline", (*HEAVY, "rich", "typer", "arviz_stats", "xarray")) == set()


def test_a_file_is_looked_at_without_a_compiler(tmp_path: Path) -> None:
    t = np.linspace(0.0, 20.0, 1000)
    y = 0.3 * np.exp(-0.05 * t) * np.cos(4.0 * t) + 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    np.savetxt(tmp_path / "rig.csv", np.c_[t, y], delimiter=",", header="t (s),angle (rad)", comments="")
    assert loaded(command("look", str(tmp_path / "rig.csv"))) <= {"scipy.interpolate", "scipy.optimize"}


FIT = """
import bayesdamp as bd
made = bd.simulate({"viscous": 0.05}, stiffness=20.0, theta0=0.3, duration=6.0, samples=150, noise_sd=0.003, seed=1)
fit = bd.fit(made, bd.Model("viscous", noise="gaussian", deviation="none"))
bd.evidence(bd.sample(fit, warmup=50, draws=50, seed=1)).summary()
"""


def test_a_fit_is_made_and_weighed_without_jax() -> None:
    """Negative control: a NumPyro model of it needs JAX."""
    before = "import sys\nassert 'jax' not in sys.modules\n"
    assert "jax" in loaded(FIT + before + "fit.density.numpyro()")


def test_a_rough_frequency_is_that_of_the_law() -> None:
    for law, values in {
        "linear": {"stiffness": 20.0, "rest_angle": 0.1},
        "pendulum": {"stiffness": 20.0, "rest_angle": -0.2},
        "horizontal_pendulum": {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0},
        "duffing": {"stiffness": 20.0, "rest_angle": 0.0, "cubic": 5.0},
    }.items():
        one = Oscillator(tuple(TERMS.names())[:1], law)
        assert one.rough_frequency(values, 0.3) == pytest.approx(one.natural_frequency(values, 0.3), rel=3e-3)
