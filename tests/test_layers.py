"""The layers hold: every import in the package, wherever it stands in a module, goes one way."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "bayesdamp"

NEUTRAL = {"types", "units", "folders", "plugins", "sources", "priors", "programs", "processes", "numerics"}
REGISTRIES = {"estimators", "inference.samplers", "inference.noise", "inference.evidence"}
"""Packages that `config` asks for names; it imports no module inside them."""

MAY_IMPORT: dict[str, set[str]] = {
    **{name: NEUTRAL for name in NEUTRAL},
    "physics": NEUTRAL | {"physics"},
    "signals": NEUTRAL | {"physics", "signals"},
    "envelope": NEUTRAL | {"signals", "envelope"},
    "config": NEUTRAL | {"physics", "config"} | REGISTRIES,
    "estimators": NEUTRAL | {"physics", "signals", "estimators"},
    "inference": NEUTRAL | {"physics", "signals", "inference"},
    "verdict": NEUTRAL | {"physics", "inference", "verdict"},
    "store": NEUTRAL | {"store"},
    "simulated": NEUTRAL | {"physics", "signals", "config", "store"},
    "report": NEUTRAL | {"store", "verdict", "report"},
    "validation": NEUTRAL | {"validation"},
    "interface": NEUTRAL
    | {
        "physics",
        "signals",
        "config",
        "estimators",
        "estimators.shared",
        "inference",
        "store",
        "study",
        "verdict",
        "report",
        "answer",
        "interface",
    },
}
ACROSS = {"answer", "study", "calibration", "claims", "commands", "cli", "", "__main__"}
"""The pipeline, the commands, and the public interface import what they join; nothing imports these."""


def imported(source: str, module: str) -> set[str]:
    """Modules of the package that a module's source imports, without the package's own name."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = module.split(".")[: -node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            found |= {base} | (
                {f"{base}.{alias.name}" for alias in node.names} if base == "bayesdamp" else set()
            )
    inside = {name.removeprefix("bayesdamp.") for name in found if name.startswith("bayesdamp.")}
    return {name for name in inside if not name.startswith("__")}


def backward(source: str, module: str) -> list[str]:
    """What a module imports and may not: `module -> imported`."""
    unit = module.removeprefix("bayesdamp").removeprefix(".").partition(".")[0]
    if unit in ACROSS:
        return []
    assert unit in MAY_IMPORT, f"{module} is in no layer: give {unit} one in {Path(__file__).name}"
    allowed = MAY_IMPORT[unit]
    whole = {name for name in allowed if name not in REGISTRIES or unit == name}
    faults = []
    for name in sorted(imported(source, module)):
        if name.partition(".")[0] not in whole and name not in allowed:
            faults.append(f"{module} -> bayesdamp.{name}")
    return faults


def modules() -> list[tuple[str, Path]]:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found.append((".".join(part for part in parts if part != "__init__"), path))
    return found


def test_no_import_goes_backward() -> None:
    found = modules()
    assert len(found) > 20
    faults = [fault for name, path in found for fault in backward(path.read_text(encoding="utf-8"), name)]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("bayesdamp.physics.oscillator", "from bayesdamp.records.oscillation.features import features"),
        ("bayesdamp.physics.oscillator", "def f():\n    import bayesdamp.pipeline"),
        ("bayesdamp.records.read", "from bayesdamp import estimators"),
        ("bayesdamp.estimators.refine", "from bayesdamp.inference.model.target import make_target"),
        ("bayesdamp.inference.model.target", "from bayesdamp.estimators import ESTIMATORS"),
        ("bayesdamp.estimators.methods.pinn", "from ...inference import target"),
        ("bayesdamp.report.render", "from bayesdamp.physics.oscillator import Oscillator"),
        ("bayesdamp.report.render", "if TYPE_CHECKING:\n    from bayesdamp.config import Study"),
        ("bayesdamp.store", "from bayesdamp.report import render"),
        ("bayesdamp.config.load", "from bayesdamp.estimators.methods.pinn import PLUGIN"),
        ("bayesdamp.config.load", "from bayesdamp.records.read import read_record"),
        ("bayesdamp.types", "from bayesdamp.physics.damping import TERMS"),
        ("bayesdamp.validation.truth.records", "from bayesdamp.physics.integrate import simulate"),
        ("bayesdamp.inference.model.target", "from bayesdamp.interface.model import Model"),
    ],
)
def test_a_backward_import_is_seen(module: str, source: str) -> None:
    assert len(backward(source, module)) == 1


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("bayesdamp.pipeline", "from bayesdamp.inference.model.target import make_target"),
        ("bayesdamp.config.load", "from bayesdamp.estimators import ESTIMATORS"),
        ("bayesdamp.estimators.methods.pinn", "from ..shared import known"),
        ("bayesdamp.inference.model.target", "from bayesdamp import __version__\nimport numpy"),
    ],
)
def test_a_forward_import_passes(module: str, source: str) -> None:
    assert not backward(source, module)


def test_a_module_without_a_layer_is_refused() -> None:
    with pytest.raises(AssertionError, match="is in no layer"):
        backward("import numpy", "bayesdamp.helpers")
