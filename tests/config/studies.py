"""Study files of a few lines, and the error message of a wrong one."""

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.types import InputError

SYSTEM = """
[system]
restoring = "linear"
stiffness = 20.0
rest_angle = 0.0
theta0 = 0.3
omega0 = 0.0
"""
SIGNAL = """
[[signal]]
name = "one"
simulate = { viscous = 0.05, duration = 10.0, samples = 100, noise_sd = 0.003 }
"""
FILE_SIGNAL = """
[[signal]]
name = "rig"
file = "rig.csv"
time = 1
angle = "phi"
"""
GOOD = "version = 1\n" + SYSTEM + SIGNAL
VARIANT = """
[estimators]
use = ["sindy", "by_sign"]
[estimators.by_sign]
variant_of = "sindy"
switch = "sign"
"""


def write(folder: Path, text: str) -> Path:
    (folder / "rig.csv").write_text("t,phi\n0,1\n")
    path = folder / "study.toml"
    path.write_text(text)
    return path


def fault(folder: Path, text: str) -> str:
    """Return the line of the error that the study causes, without the file's name."""
    path = write(folder, text)
    with pytest.raises(InputError) as caught:
        load_study(path)
    line = str(caught.value)
    assert "\n" not in line
    assert line.startswith(f"{path}: ")
    return line.removeprefix(f"{path}: ")
