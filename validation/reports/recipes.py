"""List the commands that make each report under reports/, and the sources that its numbers depend on."""

from dataclasses import dataclass

ENGINE = tuple(
    f"bayesdamp/{part}"
    for part in (
        "inference", "interface/answer.py", "interface/envelopes.py", "interface/fit.py",
        "interface/model.py", "interface/first_words.py", "interface/posterior.py",
        "numerics", "physics", "pipeline", "records", "verdict", "priors.py", "types.py",
    )
)  # fmt: skip
"""Paths of the code that computes answers, posteriors and evidence. Almost every report depends on it."""
ESTIMATORS = (*ENGINE, "bayesdamp/estimators")
"""Paths of the code on which a report with estimates depends."""
TRUTH = (*ENGINE, "validation/truth", "validation/scoring.py")
"""Paths of the code on which a report depends that compares answers with the truth of simulated records."""
PYTHON = "{python} -m"
"""Beginning of a command that runs a Python module; {python} is replaced by the interpreter."""
PAGES = "validation.reports"
"""Package of the modules that write pages of reports."""


@dataclass(frozen=True)
class Recipe:
    """How to make a report.

    Attributes
    ----------
    name : str
        Its folder or page under reports/.
    cost : int
        Approximate time in minutes on two cores.
    commands : tuple of str
        Commands that run one after the other in the root folder of the project; each resumes an interrupted run.
        {python} is replaced by the interpreter, {out} by the folder or page of the report, and {work} by a folder for
        intermediate files, which is a new one if the sources have changed.
    sources : tuple of str
        Files and folders, relative to the root folder, on which the numbers of the report depend.
    """

    name: str
    cost: int
    commands: tuple[str, ...]
    sources: tuple[str, ...]


def _study(name: str, cost: int, *after: str, sources: tuple[str, ...] = ()) -> Recipe:
    command = f"{PYTHON} bayesdamp study studies/{name}.toml --out {{out}} --quiet"
    return Recipe(name, cost, (command, *after), (*ESTIMATORS, f"studies/{name}.toml", *sources))


def _calibration(name: str, cost: int, options: str = "") -> Recipe:
    command = f"{PYTHON} bayesdamp calibrate studies/{name}.toml --out {{out}}{options}"
    page = f"{PYTHON} {PAGES}.calibration {{out}}"
    sources = *ESTIMATORS, "bayesdamp/calibrate", f"studies/{name}.toml", "validation/reports/calibration.py"
    return Recipe(name, cost, (command, page), sources)


def _page(name: str, cost: int, module: str, options: str, *sources: str) -> Recipe:
    """Return the recipe of a report whose module simulates records, answers them and writes the page."""
    command = f"{PYTHON} {module} {{work}}/rows.csv {{out}} {options}"
    return Recipe(name, cost, (command,), (*TRUTH, *sources))


RECIPES: tuple[Recipe, ...] = (
    _study("sign_or_tanh", 2),
    _page("deviation", 10, f"{PAGES}.accuracy", "deviation", "validation/reports/accuracy.py"),
    _page("misfit", 4, f"{PAGES}.misfit", "--seed 22 --count 6", "validation/reports/misfit.py"),
    _page("laws", 6, "validation.experiments.laws", "--each 8", "validation/experiments/laws.py"),
    _calibration("calibration", 7),
    _calibration("model_recovery", 6, " --models"),
    _page("contest", 8, "validation.contest", "--seed 813", "validation/contest"),
    _page("light", 14, f"{PAGES}.accuracy", "light", "validation/reports/accuracy.py"),
    Recipe(
        "measured", 6, (f"{PYTHON} validation.measured.run {{out}}",),
        (*ENGINE, "validation/measured", "validation/measured/records.toml"),
    ),
    _study("paper", 7),
    _study(
        "noise", 6, f"{PYTHON} {PAGES}.noise {{out}}",
        sources=("validation/reports/noise.py", "bayesdamp/report/results"),
    ),
    Recipe(
        "claims.md", 1,
        (f"{PYTHON} bayesdamp claims --paper reports/paper --noise reports/noise --out {{out}}",),
        (*ESTIMATORS, "bayesdamp/claims", "reports/paper/estimates.csv", "reports/noise/estimates.csv"),
    ),
)  # fmt: skip
"""All reports, in the order in which they are made. A report comes after the reports whose files it reads."""
