"""Studies of a few lines: a linear oscillator and one record."""

import re
from pathlib import Path

from bayesdamp.config import Study, load_study
from bayesdamp.pipeline.run import run_study
from bayesdamp.store.files import read_table

SYSTEM = 'restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = 0.3, omega0 = 0.0'
ESTIMATED = 'estimators = { use = ["least_squares"], stages = ["initial"] }'
COMPARED = 'models = { compare = ["viscous", "quadratic"] }'
WEIGHED = "posterior = { samplers = [] }\nevidence = { methods = ['laplace'], referee = 'never' }"

VISCOUS = "viscous = 0.05, duration = 10.0, samples = 100, noise_sd = 0.003"
"""A simulated record of a few cycles."""
PLUGINS = {"cubic_drag": "howto/own-term.md", "soft_spring": "extending.md", "thinning": "extending.md"}
"""Names of plug-ins, and the pages of docs/ that define them."""


def plugin_source(name: str) -> str:
    """Return the source of a plug-in of `PLUGINS`: a whole block of its page."""
    page = (Path(__file__).parents[1] / "docs" / PLUGINS[name]).read_text(encoding="utf-8")
    return next(b for b in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if f'name = "{name}"' in b)


def signal_text(name: str, simulate: str = "", **keys: str) -> str:
    """Return the text of a signal: a simulated record, or a file with its other keys."""
    lines = [f"simulate = {{ {simulate} }}"] if simulate else []
    lines += [f'{key} = "{value}"' for key, value in keys.items()]
    return "\n".join(["[[signal]]", f'name = "{name}"', *lines, ""])


def study_text(
    *keys: str, simulate: str = "", name: str = "rig", system: str = SYSTEM, seed: int = 3, **of_signal: str
) -> str:
    """Return the text of a study: its keys, and its one signal."""
    head = ["version = 1", 'name = "small"', f"seed = {seed}", f"system = {{ {system} }}" if system else ""]
    return "\n".join([*head, *keys, signal_text(name, simulate, **of_signal)])


def tables_of(run: Path) -> dict[str, list[str]]:
    """Return the rows of all tables of a run, without seconds."""
    files = sorted(run.glob("*.csv"))
    assert len(files) > 3
    return {f.name: [repr({**row, "seconds": 0}) for row in read_table(f)] for f in files}


def finish_study(folder: Path, text: str) -> Path:
    """Run a study to its end without a failure, and return the folder of the run, out."""
    assert run_study(write_study(folder, text), folder / "out", workers=1) == 0
    return folder / "out"


def write_study(folder: Path, text: str) -> Study:
    """Write a study's file, study.toml, and load it."""
    (folder / "study.toml").write_text(text, encoding="utf-8")
    return load_study(folder / "study.toml")
