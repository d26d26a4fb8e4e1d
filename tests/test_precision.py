"""Double precision, whichever is imported first."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


def said(code: str) -> str:
    own = {k: v for k, v in os.environ.items() if k != "JAX_ENABLE_X64"}
    return subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env=own
    ).stdout


@pytest.mark.parametrize("first", ["import bayesdamp, jax", "import jax, bayesdamp"])
def test_arrays_are_double(first):
    assert said(f"{first}; print(jax.numpy.ones(2).dtype)") == "float64\n"


def test_without_the_package_they_are_not():
    """The negative control."""
    assert said("import jax; print(jax.numpy.ones(2).dtype)") == "float32\n"
