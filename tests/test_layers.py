"""Every import in the package, at the top of a module or inside a function, goes from an upper layer to a lower one."""

import ast
from collections.abc import Container
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
OUTSIDE = "validation"
"""The folder that evaluates the package as a user would: the package never imports it."""

NEUTRAL = {
    "types", "plugins", "plain_text", "sources", "priors", "serial", "calls", "machine",
    "numerics", "formatting",
}  # fmt: skip
REGISTRIES = {"estimators", "inference.samplers", "inference.noise", "inference.evidence"}
"""Packages that `config` asks for names; it imports no module inside them."""
INFERENCE = (
    "noise", "model", "mode", "derived", "coordinates", "checks",
    "diagnostics", "samplers", "evidence",
)  # fmt: skip
"""From bottom to top: each module or folder imports those before it, and itself."""
_BELOW = NEUTRAL | {"physics", "records"}

MAY_IMPORT: dict[str, set[str]] = {
    **{name: NEUTRAL for name in NEUTRAL},
    "physics": NEUTRAL | {"physics"},
    "records.files": NEUTRAL | {"records.files"},
    "records.readers": NEUTRAL | {"records.files", "records.readers"},
    "records.oscillation": NEUTRAL | {"records.oscillation"},
    "records.columns": NEUTRAL | {"records.oscillation", "records.files", "records.columns"},
    "records.cleaning": NEUTRAL
    | {"records.record", "records.files", "records.oscillation", "records.cleaning"},
    "records": NEUTRAL | {"physics", "records"},
    "config": NEUTRAL | {"physics", "config"} | REGISTRIES,
    "estimators.networks": _BELOW | {"estimators.shared", "estimators.networks"},
    "estimators.regression": _BELOW | {"estimators.shared", "estimators.regression"},
    "estimators": _BELOW | {"estimators"},
    **{
        f"inference.{name}": _BELOW | {f"inference.{below}" for below in INFERENCE[: i + 1]}
        for i, name in enumerate(INFERENCE)
    },
    "inference.deviation": _BELOW
    | {"inference.noise", "inference.model", "inference.mode", "inference.checks", "inference.diagnostics"}
    | {"inference.deviation"},
    "inference.envelope": _BELOW | {"inference.deviation", "inference.envelope"},
    "inference": set(),
    "verdict": NEUTRAL | {"physics", "inference", "store", "verdict"},
    "store": NEUTRAL | {"store"},
    "report": NEUTRAL | {"physics.symbols", "store", "verdict", "report"},
    "calibrate": _BELOW
    | {"config", "estimators", "inference", "store", "interface", "pipeline", "report", "calibrate"},
    "claims": _BELOW | {"estimators", "report", "claims"},
    "validation.truth": NEUTRAL | {"validation.truth"},
    "interface": NEUTRAL
    | {
        "physics", "records", "config", "estimators", "inference", "store", "verdict", "report", "interface",
    },
    "pipeline": _BELOW
    | {"config", "estimators", "inference", "store", "verdict", "report", "interface", "pipeline"},
}  # fmt: skip
ACROSS = {"cli", "", "__main__", OUTSIDE}
"""The commands, the list of public names and the evaluation may import from every folder."""


def imported(source: str, module: str, known: Container[str]) -> set[str]:
    """Return the `known` modules that a source imports: at its top, in functions, or for type checkers."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f"{module}: import by the full name"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in known else str(node.module) for name in inner}
    return {name for name in names if name in known and name != module}


def inside(name: str, unit: str) -> bool:
    return name == unit or name.startswith(f"{unit}.")


def backward(source: str, module: str) -> list[str]:
    """Return the imports of a module that its layer does not allow: `module -> imported`."""
    name = module.removeprefix("bayesdamp").removeprefix(".")
    others = sorted(other.removeprefix("bayesdamp.") for other in imported(source, module, MODULES))
    units = [unit for unit in MAY_IMPORT if inside(name, unit)]
    if not units and name.partition(".")[0] in ACROSS:
        return [f"{module} -> {o}" for o in others if inside(o, OUTSIDE) and not inside(name, OUTSIDE)]
    assert units, f"{module} is in no layer: give {name} one in {Path(__file__).name}"
    unit = max(units, key=len)
    allowed = MAY_IMPORT[unit] | {"bayesdamp"}
    whole = allowed - REGISTRIES if unit == "config" else allowed
    wrong = (o for o in others if o not in allowed and not any(inside(o, unit) for unit in whole))
    return [f"{module} -> {other}" for other in wrong]


MODULES = {
    ".".join(part for part in path.relative_to(ROOT).with_suffix("").parts if part != "__init__"): path
    for folder in ("bayesdamp", OUTSIDE)
    for path in sorted((ROOT / folder).rglob("*.py"))
}
"""The files of all modules, by their names."""


def test_no_module_imports_from_an_upper_layer() -> None:
    assert len(MODULES) > 20
    faults = [f for name, path in MODULES.items() for f in backward(path.read_text(encoding="utf-8"), name)]
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize(
    ("faults", "module", "source"),
    [
        (1, "bayesdamp.physics.oscillator", "def f():\n    import bayesdamp.pipeline"),
        (1, "bayesdamp.config.load", "from bayesdamp.estimators.methods.pinn import PLUGIN"),
        (1, "bayesdamp.calibrate.run", "from validation.truth.records import case"),
        (0, "bayesdamp.config.load", "from bayesdamp.estimators import ESTIMATORS"),
    ],
)
def test_an_import_from_an_upper_layer_is_reported(faults: int, module: str, source: str) -> None:
    assert len(backward(source, module)) == faults


def test_a_module_without_a_layer_is_refused() -> None:
    with pytest.raises(AssertionError, match="is in no layer"):
        backward("import numpy", "bayesdamp.helpers")


DOOR = "bayesdamp"
"""The package imports a public name when it is first requested, so its own imports are not counted."""


def graph_of(sources: dict[str, str]) -> dict[str, set[str]]:
    """Return the modules that each module imports, by its name."""
    return {m: imported("" if m == DOOR else source, m, sources) for m, source in sources.items()}


def test_no_modules_import_each_other_in_a_circle() -> None:
    sources = {name: path.read_text(encoding="utf-8") for name, path in MODULES.items()}
    TopologicalSorter(graph_of(sources)).prepare()
    with pytest.raises(CycleError):
        TopologicalSorter(graph_of({**sources, "bayesdamp.types": "import bayesdamp.records.read"})).prepare()
