"""The key of a task changes if and only if the source of the code that computes it changes."""

import ast
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from bayesdamp.pipeline.tasks import CODE
from bayesdamp.sources import ROOT, UNRELATED_MODULES, direct_imports, import_closure
from tests.studies import COMPARED, VISCOUS, study_text
from tests.test_layers import MODULES as EVERY

SCRIPT = """
import json, sys
from pathlib import Path
import bayesdamp
from bayesdamp.config import load_study
from bayesdamp.store.results import Store
from bayesdamp.pipeline.jobs import jobs_of, tasks_of
assert bayesdamp.__file__.startswith(sys.argv[1])
study = load_study(sys.argv[2])
print(json.dumps({t.name: t.key for job in jobs_of(study) for t in tasks_of(study, Store(Path("x")), job)}))
"""
STUDY = study_text(
    'estimators = { use = ["least_squares", "sindy"] }',
    COMPARED,
    'posterior = { samplers = ["nuts", "emcee"] }',
    'evidence = { methods = ["importance"], referee = "never" }',
    simulate=VISCOUS,
    name="rig",
)


AFTER_SINDY = tuple(f"{kind}/rig/0/viscous" for kind in ("mode", "posterior", "evidence"))
"""Tasks that start from estimates; those of the sparse regression use all damping terms."""


MODULES = {name: path for name, path in EVERY.items() if name.startswith("bayesdamp")}


def by_parser(path: Path) -> set[str]:
    """Return the modules of the package that a module imports, except under TYPE_CHECKING, by Python's own parser."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    tree.body = [n for n in tree.body if not (isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test))]
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names |= {str(node.module), *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names & set(MODULES)


def test_direct_imports_are_those_of_the_parser():
    """A module may contain a program for another process that imports the module itself. Control: another module."""
    for name, path in MODULES.items():
        assert by_parser(path) - {name} == set(direct_imports(name)) & set(MODULES) - {name}, name
    other = direct_imports("bayesdamp.pipeline.candidates.tasks")
    assert by_parser(MODULES["bayesdamp.pipeline.run"]) != other


def test_the_code_of_each_kind_of_task_contains_physics_and_nothing_unrelated():
    for kind in CODE:
        assert set(CODE[kind]) <= set(MODULES)
        modules = import_closure(CODE[kind])
        assert any(name.startswith("bayesdamp.physics.") for name in modules)
        assert "bayesdamp.pipeline.run" not in modules, "any change would change every key"
        assert not [name for name in modules - set(CODE[kind]) if name.startswith(UNRELATED_MODULES)]
        # A plug-in is added to the keys where it is used.
        assert "bayesdamp.physics.damping.viscous" not in modules


@pytest.fixture(scope="module")
def copy(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(ROOT, folder / "bayesdamp", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "s.toml").write_text(STUDY, encoding="utf-8")
    return folder


def keys(copy: Path) -> dict[str, str]:
    command = [sys.executable, "-c", SCRIPT, str(copy), str(copy / "s.toml")]
    env = {**os.environ, "PYTHONPATH": str(copy)}
    done = subprocess.run(command, env=env, cwd=copy, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "changes"),
    [
        ("report/sections/__init__.py", ()),
        ("cli/app.py", ()),
        ("inference/samplers/emcee.py", ("/emcee",)),
        ("physics/damping/quadratic.py", ("quadratic", "viscous/sindy", "answer/", "sampled/", *AFTER_SINDY)),
        ("physics/oscillator.py", ("",)),
    ],
)
def test_a_changed_line_changes_the_keys_of_what_depends_on_it(copy, file, changes):
    before, path = keys(copy), copy / "bayesdamp" / file
    text = path.read_text(encoding="utf-8")
    path.write_text(text + "\n# another line\n", encoding="utf-8")
    try:
        after = keys(copy)
    finally:
        path.write_text(text, encoding="utf-8")
    changed = {n for n in before if before[n] != after[n]}
    assert changed == {n for n in before if any(part in n for part in changes)}
    assert keys(copy) == before
