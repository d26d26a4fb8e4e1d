"""What makes each folder under reports/, and of which sources its numbers are made."""

from __future__ import annotations

from dataclasses import dataclass

ENGINE = tuple(
    f"bayesdamp/{part}"
    for part in (
        "inference", "numerics", "physics", "pipeline", "records", "verdict", "priors.py", "types.py", "units.py",
    )
)  # fmt: skip
"""What answers, posteriors and evidence are computed by."""
ESTIMATORS = (*ENGINE, "bayesdamp/estimators")
TRUTH = (
    *ENGINE,
    "bayesdamp/validation/truth",
    "bayesdamp/validation/answers.py",
    "bayesdamp/validation/run.py",
)
QUICK = "bayesdamp.pipeline.answer:quick_verdict"
PYTHON = "{python} -m"
DISCREPANT = f"{PYTHON} bayesdamp.validation.run --answer {QUICK} --group discrepant"


@dataclass(frozen=True)
class Recipe:
    """One report.

    name: its folder or page under reports/. cost: roughly, in minutes of two cores. commands: run in the project's
    root one after the other, each resuming what an earlier run left; {python}, {work} (a folder that holds what is
    not shipped, another for other sources) and {out} stand for themselves. sources: files and folders, relative to
    the root, whose code the numbers depend on.
    """

    name: str
    cost: int
    commands: tuple[str, ...]
    sources: tuple[str, ...]


def _study(name: str, cost: int) -> Recipe:
    made = f"{PYTHON} bayesdamp study studies/{name}.toml --out {{out}} --quiet"
    return Recipe(name, cost, (made,), (*ESTIMATORS, f"studies/{name}.toml"))


def _calibration(name: str, cost: int, options: str = "") -> Recipe:
    made = f"{PYTHON} bayesdamp calibrate studies/{name}.toml --out {{out}}{options}"
    return Recipe(name, cost, (made,), (*ENGINE, "bayesdamp/validation/calibration", f"studies/{name}.toml"))


RECIPES: tuple[Recipe, ...] = (
    _study("paper", 10),
    _study("sign_or_tanh", 2),
    Recipe("measured", 15, (f"{PYTHON} tests.measured.run {{out}}",), (*ENGINE, "tests/measured")),
    Recipe(
        "deviation", 60,
        (
            f"{PYTHON} bayesdamp.validation.run --answer {QUICK} --group family --seed 901 --count 40 --deviation none "
            "--out {work}/rows.csv",
            f"{PYTHON} bayesdamp.validation.run --answer {QUICK} --group family --seed 901 --count 40 "
            "--out {work}/rows.csv",
            f"{DISCREPANT} --seed 901 --count 100 --out {{work}}/rows.csv",
            f"{DISCREPANT} --seed 901 --count 30 --oversample 10 --out {{work}}/rows.csv",
            f"{PYTHON} bayesdamp.validation.reports.deviation {{work}}/rows.csv {{out}}",
        ),
        (*TRUTH, "bayesdamp/validation/scoring.py", "bayesdamp/validation/reports/deviation.py"),
    ),
    Recipe(
        "evidence_audit", 30,
        (f"{PYTHON} tests.inference.evidence.audit {{work}}/touching_zero.csv",
         "cp {work}/touching_zero.csv {out}/touching_zero.csv"),
        (*ENGINE, "tests/inference/evidence/audit.py"),
    ),
    _calibration("calibration", 240),
    _calibration("calibration_known", 60),
    _calibration("calibration_noisy", 120),
    _calibration("model_recovery", 240, " --models"),
    _study("noise", 150),
    Recipe(
        "claims.md", 10,
        (f"{PYTHON} bayesdamp claims --paper reports/paper --noise reports/noise --out {{out}}",),
        (*ESTIMATORS, "bayesdamp/validation/claims", "reports/paper/estimates.csv", "reports/noise/estimates.csv"),
    ),
    Recipe(
        "misfit", 300,
        (f"{PYTHON} tests.misfit.run {{work}}/scored.csv --seed 8 --count 12",
         "cp {work}/scored.csv {out}/scored.csv"),
        (*ENGINE, "tests/misfit"),
    ),
)  # fmt: skip
"""The cheap ones first."""
