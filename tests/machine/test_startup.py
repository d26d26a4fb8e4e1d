"""Imports: no command loads a compiler before it computes, and a fit needs no JAX."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.physics.oscillator import Oscillator
from tests.records.tables import write_table

ROOT = Path(__file__).parents[2]
SCIPY = ("scipy.optimize", "scipy.interpolate", "scipy.signal")
HEAVY = ("jax", "numba", "torch", "pandas", "matplotlib", *SCIPY)


def output_of(code: str) -> str:
    """Return the output of a new process, whose environment does not configure JAX."""
    environment = {k: v for k, v in os.environ.items() if k != "JAX_ENABLE_X64"}
    command = [sys.executable, "-c", code]
    return subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=True, env=environment
    ).stdout


def modules_after(source: str, modules: tuple[str, ...] = HEAVY) -> set[str]:
    """Return which of the modules a new process has loaded after this source."""
    code = f"{source}\nimport sys\nprint('loaded:', *(n for n in {modules!r} if n in sys.modules))"
    return set(output_of(code).rpartition("loaded:")[2].split())


@pytest.mark.parametrize("first", ["import bayesdamp, jax", "import jax, bayesdamp", "import jax"])
def test_jax_has_double_precision_with_the_package_whichever_is_imported_first(first: str) -> None:
    """Control: JAX without the package."""
    dtype = "float64" if "bayesdamp" in first else "float32"
    assert output_of(f"{first}; print(jax.numpy.ones(2).dtype)") == f"{dtype}\n"


MAIN = "from bayesdamp.cli import main\nassert main"


@pytest.mark.parametrize(
    ("source", "further"),
    [
        ("import bayesdamp", ("numpy", "scipy", "xarray")),
        ("import bayesdamp.pipeline", ("rich", "typer", "arviz_stats", "xarray")),
        (f"{MAIN}(['check', 'studies/quickstart.toml']) == 0", ()),
    ],
)
def test_imports_and_the_command_check_load_no_heavy_modules(source: str, further: tuple[str, ...]) -> None:
    assert modules_after(source, (*HEAVY, *further)) == set()


def test_the_command_look_loads_no_compiler(tmp_path: Path) -> None:
    t = np.linspace(0.0, 20.0, 1000)
    y = 0.3 * np.exp(-0.05 * t) * np.cos(4.0 * t) + 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    file = write_table(tmp_path / "rig.csv", "t (s),angle (rad)", t, y)
    assert modules_after(f"{MAIN}(['look', {str(file)!r}]) == 0") <= {"scipy.interpolate", "scipy.optimize"}


FIT = """
import bayesdamp as bd
truth = {"stiffness": 20.0, "theta0": 0.3, "duration": 6.0, "samples": 150, "noise_sd": 0.003}
fit = bd.fit(bd.simulate({"viscous": 0.05}, seed=1, **truth), bd.Model("viscous", noise="gaussian", deviation="none"))
bd.evidence(bd.sample(fit, warmup=50, draws=50, seed=1)).summary()
"""


def test_a_fit_and_its_evidence_need_no_jax() -> None:
    """Control: a NumPyro model needs JAX."""
    before = "import sys\nassert 'jax' not in sys.modules\n"
    assert "jax" in modules_after(FIT + before + "fit.density.numpyro()")


def test_a_rough_frequency_is_that_of_the_law() -> None:
    for law, values in {
        "linear": {"stiffness": 20.0, "rest_angle": 0.1},
        "pendulum": {"stiffness": 20.0, "rest_angle": -0.2},
        "horizontal_pendulum": {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0},
        "duffing": {"stiffness": 20.0, "rest_angle": 0.0, "cubic": 5.0},
    }.items():
        body = Oscillator(("viscous",), law)
        truth = body.natural_frequency(values, 0.3)
        assert body.rough_frequency(values, 0.3) == pytest.approx(truth, rel=3e-3)
