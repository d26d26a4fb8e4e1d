"""Plug-ins from outside the package: by a study's file, in every worker, in tables, and in the keys of tasks."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import pytest

from bayesdamp.physics.damping import PAPER_TERMS, TERMS, others
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.run import run_study
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report.results.run import RunFolder, coefficients
from bayesdamp.store import Store, read_table
from tests.interface.problems import not_refused
from tests.studies import COMPARED, ESTIMATED, WEIGHED, study_text, write_study

HERE = Path(__file__).parent
DRAG = (HERE / "cubic_drag.py").read_text(encoding="utf-8")
TRUTH = 0.08
SOFT = 'restoring = "soft_spring", stiffness = "free", rest_angle = 0.0, theta0 = 0.6, omega0 = 0.0'
RECORD = "cubic_drag = 0.08, stiffness = 20.0, duration = 10.0, samples = 300, noise_sd = 0.003"
STUDY = study_text(
    'plugins = { modules = ["cubic_drag.py", "soft_spring.py"] }',
    ESTIMATED,
    'models = { compare = ["viscous", "cubic_drag"] }',
    WEIGHED,
    simulate=RECORD,
    system=SOFT,
)


def study_in(folder: Path):
    for name in ("cubic_drag.py", "soft_spring.py"):
        if not (folder / name).exists():
            shutil.copy(HERE / name, folder)
    return write_study(folder, STUDY)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The study, run once on two processes. Not to be changed by a test."""
    folder = tmp_path_factory.mktemp("own")
    assert run_study(study_in(folder), folder / "out", workers=2) == 0
    use_modules(())
    return folder


def test_workers_have_them_and_they_win(run):
    """The record was made with both: the evidence prefers them by far, and the truth lies within four sds (a false
    alarm once in 16,000 seeds)."""
    rows = {r["model"]: r for r in read_table(run / "out" / "evidence.csv")}
    assert {r["outcome"] for r in rows.values()} == {"ok"}
    assert {r["restoring"] for r in rows.values()} == {"soft_spring"}
    assert rows["cubic_drag"]["log_bayes_factor"] == 0
    assert rows["viscous"]["log_bayes_factor"] < -20
    mode = Store(run / "out").read("mode/rig/0/cubic_drag").meta
    assert abs(mode["values"]["drag3"] - TRUTH) < 4 * mode["sd"]["drag3"]


def test_tables_have_its_parameter_under_its_own_name_and_unit(run):
    rows = read_table(run / "out" / "estimates.csv")
    own = [r for r in rows if r["model"] == "cubic_drag" and r["parameter"] == "drag3"]
    assert {r["unit"] for r in own} == {"s/rad²"}
    assert {r["truth"] for r in own} == {TRUTH}
    assert all(r["error_pct"] < 100 for r in own)
    # the report, which knows nothing of the plug-in, has it from the run
    assert "cubic_drag" not in TERMS.names()
    found = RunFolder(run / "out")
    assert coefficients(found, "cubic_drag") == ["drag3"]
    assert coefficients(found, "viscous+cubic_drag") == ["zeta", "drag3"]
    assert "drag3" in (run / "out" / "report.html").read_text(encoding="utf-8")
    assert found.study["plugins"][0]["file"] == "cubic_drag.py"


def test_what_does_not_use_it_keeps_its_keys(tmp_path):
    """Of a record that was not made with it: a changed term changes the keys of the answer, which weighs them all, and
    of the candidates, whose noise and width of friction are the answer's; not those of records and estimates."""
    (tmp_path / "r.csv").write_text("t,y\n" + "".join(f"{i / 10},{(-1) ** i}\n" for i in range(50)))
    text = STUDY.replace(f"simulate = {{ {RECORD} }}", 'file = "r.csv"\ntime = "t"\nangle = "y"')
    shutil.copy(HERE / "cubic_drag.py", tmp_path)
    shutil.copy(HERE / "soft_spring.py", tmp_path)
    keys = []
    for _ in range(2):
        keys.append(keys_of(write_study(tmp_path, text), tmp_path))
        file = tmp_path / "cubic_drag.py"
        file.write_text(file.read_text().replace("1.0 * velocity**3", "0.5 * velocity**3"), encoding="utf-8")
    changed = {n for n in keys[0] if keys[0][n] != keys[1][n]}
    kept = {n for n in keys[0] if n.startswith(("signal/", "estimate/")) and "cubic_drag" not in n}
    assert changed == set(keys[0]) - kept
    assert len(changed) < len(keys[0])


def keys_of(study, folder: Path) -> dict[str, str]:
    from bayesdamp.pipeline.jobs import jobs_of, tasks_of

    return {n: k for job in jobs_of(study) for n, (k, _) in tasks_of(study, Store(folder), job).items()}


WRONG = {
    "syntax.py": ("x = 1\ndef f(:\n", "plug-in .*syntax.py, line 2: invalid syntax"),
    "fails.py": ("x = 1\ny = x / 0\n", "plug-in .*fails.py, line 2: ZeroDivisionError: division by zero"),
    "nothing.py": ("x = 1\n", "contains neither PLUGIN nor PLUGINS; end it with"),
    "number.py": ("PLUGIN = 3\n", "PLUGIN is of type int, which is not a plug-in; derive its class from a"),
    "class.py": (DRAG.replace("CubicDrag()", "CubicDrag"), r"is a class; give an instance, CubicDrag\(\)"),
    "ships.py": (
        DRAG.replace('"cubic_drag"', '"viscous"'),
        "'viscous' ships with bayesdamp; give yours another",
    ),
    "name.py": (
        DRAG.replace('"cubic_drag"', '"a+b"'),
        r"is 'a\+b'; it must consist of letters, digits and _",
    ),
}


def test_a_wrong_module_is_one_line(tmp_path):
    for name, (text, _) in WRONG.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def load(name: str) -> None:
        use_modules(read_modules([tmp_path / name]))

    cases = [(partial(load, name), said) for name, (_, said) in WRONG.items()]
    assert not_refused([*cases, (partial(load, "missing.py"), "missing.py: there is no such file")]) == []
    assert set(TERMS.names()) == {*PAPER_TERMS, *others()}


def test_one_module_after_another():
    use_modules(read_modules([HERE / "cubic_drag.py"]))
    assert TERMS.get("cubic_drag").parameter == "drag3"
    use_modules(read_modules([HERE / "soft_spring.py"]))
    assert "cubic_drag" not in TERMS.names()
    assert LAWS.get("soft_spring").parameters == ("stiffness", "rest_angle")


def test_an_installed_package_is_found_by_its_entry_point(tmp_path, monkeypatch):
    """And is not imported before it is named."""
    (tmp_path / "dragging.py").write_text(DRAG, encoding="utf-8")
    about = tmp_path / "dragging-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: dragging\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text("[bayesdamp.damping]\ncubic_drag = dragging:PLUGIN\n")
    monkeypatch.syspath_prepend(tmp_path)
    TERMS.__dict__.pop("_entries", None)
    try:
        assert "cubic_drag" in TERMS.names()
        assert "cubic_drag" not in TERMS.present()
        assert TERMS.get("cubic_drag").unit == "s/rad²"
        first = TERMS.source("cubic_drag")
        assert first == TERMS.source("cubic_drag") != TERMS.source("viscous")
    finally:
        TERMS.remove("cubic_drag")
        TERMS.__dict__.pop("_entries", None)


SHORT = study_text(
    'plugins = { modules = ["killer.py"] }',
    'estimators = { use = ["least_squares", "killer"], stages = ["initial"] }',
    COMPARED,
    "posterior = { samplers = [] }",
    "evidence = { methods = [] }",
    simulate="viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003",
)


@pytest.mark.slow
def test_an_estimator_that_kills_its_process_costs_its_own_tasks(tmp_path, capsys):
    """On two processes: every other task is done, and the run says which were lost and ends with status 3."""
    shutil.copy(HERE / "killer.py", tmp_path)
    assert run_study(write_study(tmp_path, SHORT), tmp_path / "out", workers=2) == 3
    said = " ".join(capsys.readouterr().err.split())
    outcomes = {n: Store(tmp_path / "out").read(n).outcome for n in Store(tmp_path / "out").names()}
    lost = [f"estimate/rig/0/{model}/killer" for model in ("viscous", "quadratic")]
    for name in lost:
        assert outcomes.pop(name).startswith("failed: the process that computed it was killed")
        assert f"{name}: failed: the process" in said
    assert len(outcomes) == 3
    assert set(outcomes.values()) == {"ok"}
