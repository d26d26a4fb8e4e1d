"""Plug-ins of a study: in workers, in tables, in the keys of tasks; wrong plug-ins; installed packages."""

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.physics.damping import PAPER_TERMS, TERMS, others
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.jobs import jobs_of, tasks_of
from bayesdamp.pipeline.run import run_study
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report.results.run import RunFolder, coefficients
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.interface.problems import not_refused
from tests.records.tables import write_table
from tests.studies import COMPARED, ESTIMATED, PLUGINS, WEIGHED, plugin_source, study_text, write_study

DRAG = plugin_source("cubic_drag")
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


def write_plugin(folder: Path, name: str) -> Path:
    """Write a plug-in of docs/ to a file, and return it."""
    path = folder / f"{name}.py"
    path.write_text(plugin_source(name), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run the study once on two processes; tests must not change its folder."""
    folder = tmp_path_factory.mktemp("own")
    for name in PLUGINS:
        write_plugin(folder, name)
    assert run_study(write_study(folder, STUDY), folder / "out", workers=2) == 0
    use_modules(())
    return folder


def test_the_evidence_prefers_the_plug_ins_with_which_the_record_was_simulated(run):
    """The truth is within four sds: one false alarm in 16,000 seeds."""
    rows = {r["model"]: r for r in read_table(run / "out" / "evidence.csv")}
    assert {(r["outcome"], r["restoring"]) for r in rows.values()} == {("ok", "soft_spring")}
    assert rows["cubic_drag"]["log_bayes_factor"] == 0
    assert rows["viscous"]["log_bayes_factor"] < -20
    mode = Store(run / "out").read("mode/rig/0/cubic_drag").meta
    assert abs(mode["values"]["drag3"] - TRUTH) < 4 * mode["sd"]["drag3"]


def test_tables_and_report_have_the_name_and_unit_of_the_plug_in_s_parameter(run):
    """The report has them from the run: the plug-in is not registered in this process."""
    rows = read_table(run / "out" / "estimates.csv")
    own = [r for r in rows if r["model"] == "cubic_drag" and r["parameter"] == "drag3"]
    assert {(r["unit"], r["truth"]) for r in own} == {("s/rad²", TRUTH)}
    assert all(r["error_pct"] < 100 for r in own)
    assert "cubic_drag" not in TERMS.names()
    folder = RunFolder(run / "out")
    assert coefficients(folder, "cubic_drag") == ["drag3"]
    assert coefficients(folder, "viscous+cubic_drag") == ["zeta", "drag3"]
    assert "drag3" in (run / "out" / "report.html").read_text(encoding="utf-8")
    assert folder.study["plugins"][0]["file"] == "cubic_drag.py"


def test_a_changed_plug_in_changes_only_the_keys_of_tasks_that_use_it(tmp_path):
    """The record is from a file. The answer compares all terms, and candidates use its noise model and its width of
    friction; records and estimates with other terms do not use the plug-in."""
    i = np.arange(50)
    write_table(tmp_path / "r.csv", "t,y", i / 10, (-1) ** i)
    text = STUDY.replace(f"simulate = {{ {RECORD} }}", 'file = "r.csv"\ntime = "t"\nangle = "y"')
    file, keys, store = tmp_path / "cubic_drag.py", [], Store(tmp_path)
    write_plugin(tmp_path, "soft_spring")
    for factor in ("1.0", "0.5"):
        file.write_text(DRAG.replace("v**3", f"{factor} * v**3"), encoding="utf-8")
        study = write_study(tmp_path, text)
        keys.append({t.name: t.key for job in jobs_of(study) for t in tasks_of(study, store, job)})
    changed = {n for n in keys[0] if keys[0][n] != keys[1][n]}
    unchanged = {n for n in keys[0] if n.startswith(("signal/", "estimate/")) and "cubic_drag" not in n}
    assert unchanged
    assert changed == set(keys[0]) - unchanged


WRONG = {
    "syntax.py": ("x = 1\ndef f(:\n", "plug-in .*syntax.py, line 2: invalid syntax"),
    "fails.py": ("x = 1\ny = x / 0\n", "plug-in .*fails.py, line 2: ZeroDivisionError: division by zero"),
    "nothing.py": ("x = 1\n", "contains neither PLUGIN nor PLUGINS; end it with"),
    "number.py": ("PLUGIN = 3\n", "PLUGIN is of type int, which is not a plug-in; derive its class from a"),
    "class.py": (DRAG.replace("CubicDrag()", "CubicDrag"), r"is a class; give an instance, CubicDrag\(\)"),
    "ships.py": (DRAG.replace("cubic_drag", "viscous"), "'viscous' ships with bayesdamp; give yours another"),
    "name.py": (DRAG.replace("cubic_drag", "a+b"), r"is 'a\+b'; it must consist of letters, digits and _"),
}


def test_a_wrong_module_is_refused_in_one_line(tmp_path):
    for name, (text, _) in WRONG.items():
        (tmp_path / name).write_text(text, encoding="utf-8")

    def load(name: str) -> None:
        use_modules(read_modules([tmp_path / name]))

    cases = [(partial(load, name), line) for name, (_, line) in WRONG.items()]
    assert not_refused([*cases, (partial(load, "missing.py"), "missing.py: there is no such file")]) == []
    assert set(TERMS.names()) == {*PAPER_TERMS, *others()}


def test_the_next_plug_ins_replace_those_before(tmp_path):
    use_modules(read_modules([write_plugin(tmp_path, "cubic_drag")]))
    assert TERMS.get("cubic_drag").parameter == "drag3"
    use_modules(read_modules([write_plugin(tmp_path, "soft_spring")]))
    assert "cubic_drag" not in TERMS.names()
    assert LAWS.get("soft_spring").parameters == ("stiffness", "rest_angle")


def test_an_installed_package_is_found_by_its_entry_point(tmp_path, monkeypatch):
    """It is not imported before it is used. A module without PLUGIN and a class with arguments are refused."""
    (tmp_path / "dragging.py").write_text(DRAG, encoding="utf-8")
    metadata = tmp_path / "dragging-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: dragging\nVersion: 1.0\n")
    entries = "cubic_drag = dragging:PLUGIN\nmodule = bayesdamp.plain_text\nneeds = bayesdamp.types:Signal"
    (metadata / "entry_points.txt").write_text(f"[bayesdamp.damping]\n{entries}\n")
    monkeypatch.syspath_prepend(tmp_path)
    TERMS.__dict__.pop("_entries", None)
    try:
        assert "cubic_drag" in {*TERMS.names()} - {*TERMS.present()}
        assert TERMS.get("cubic_drag").unit == "s/rad²"
        assert TERMS.source("cubic_drag") == TERMS.source("cubic_drag") != TERMS.source("viscous")
        wrong = {"module": "AttributeError: .* 'PLUGIN'", "needs": "TypeError: .* missing 2 required"}
        assert not_refused((partial(TERMS.get, name), why) for name, why in wrong.items()) == []
    finally:
        TERMS.remove("cubic_drag")
        TERMS.__dict__.pop("_entries", None)


KILLED = study_text(
    'plugins = { modules = ["killer.py"] }',
    'estimators = { use = ["least_squares", "killer"], stages = ["initial"] }',
    COMPARED,
    "posterior = { samplers = [] }",
    "evidence = { methods = [] }",
    simulate="viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003",
)


@pytest.mark.slow
def test_an_estimator_that_kills_its_process_loses_only_its_own_tasks(tmp_path, capsys):
    """On two processes: every other task is computed; the run names the lost tasks and ends with status 3."""
    shutil.copy(Path(__file__).with_name("killer.py"), tmp_path)
    assert run_study(write_study(tmp_path, KILLED), tmp_path / "out", workers=2) == 3
    printed = " ".join(capsys.readouterr().err.split())
    store = Store(tmp_path / "out")
    outcomes = {n: store.read(n).outcome for n in store.names()}
    for name in [f"estimate/rig/0/{model}/killer" for model in ("viscous", "quadratic")]:
        assert outcomes.pop(name).startswith("failed: the process that computed it was killed")
        assert f"{name}: failed: the process" in printed
    assert len(outcomes) == 3
    assert set(outcomes.values()) == {"ok"}
