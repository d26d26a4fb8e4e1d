"""A run.json given back asks the same again, and says so where it cannot."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.config import load_study
from bayesdamp.config.load import record_question, shipped_folder, study_file
from bayesdamp.store import provenance
from bayesdamp.types import InputError
from tests.studies import WEIGHED, study_text

FREE = 'system = { theta0 = "free", omega0 = "free" }\n'
STUDY = study_text(
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    WEIGHED,
    simulate="viscous = 0.1, theta0 = 0.3, omega0 = 0.0, duration = 8.0, samples = 160, noise_sd = 0.003",
    name="made",
    system='restoring = "linear", stiffness = 20.0, rest_angle = 0.0, noise_sd = "free"',
)
STUDY += f'{FREE}[[signal]]\nname = "read"\nfile = "rig.csv"\ntime = 1\nangle = 2\n{FREE}'


@pytest.fixture
def study(tmp_path: Path) -> Path:
    folder = tmp_path / "mine"
    folder.mkdir()
    t = np.linspace(0.0, 8.0, 160)
    y = 0.3 * np.exp(-0.1 * t) * np.cos(4.47 * t) + 0.003 * np.random.default_rng(1).standard_normal(t.size)
    np.savetxt(folder / "rig.csv", np.c_[t, y], delimiter=",")
    path = folder / "small.toml"
    path.write_text(STUDY, encoding="utf-8")
    return path


def remembered(study: Path, out: Path) -> Path:
    """A run.json with what it says of its question, without the run."""
    loaded = load_study(study)
    inputs = provenance({"rig.csv": study.with_name("rig.csv")})["inputs"]
    out.mkdir()
    known = {"name": loaded.name, "study": loaded.resolved(), "inputs": inputs}
    path = out / "run.json"
    path.write_text(json.dumps({**known, "asked": record_question(loaded, out)}), encoding="utf-8")
    return path


def test_it_is_the_same_question(study: Path, tmp_path: Path) -> None:
    again = load_study(remembered(study, tmp_path / "out"))
    assert again.resolved() == load_study(study).resolved()


def test_the_files_may_have_moved_beside_it(study: Path, tmp_path: Path) -> None:
    path = remembered(study, tmp_path / "out")
    shutil.move(study.with_name("rig.csv"), tmp_path / "out" / "rig.csv")
    assert load_study(path).signals[1].source.path == tmp_path / "out" / "rig.csv"  # type: ignore[union-attr]


def test_another_file_is_refused(study: Path, tmp_path: Path) -> None:
    path = remembered(study, tmp_path / "out")
    study.with_name("rig.csv").write_text("0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"run\.json: rig\.csv has changed since the run"):
        load_study(path)
    study.with_name("rig.csv").unlink()
    with pytest.raises(InputError, match=r"the input file rig\.csv of the run is missing"):
        load_study(path)


def test_a_missing_plugin_is_told(study: Path, tmp_path: Path) -> None:
    path = remembered(study, tmp_path / "out")
    run = json.loads(path.read_text(encoding="utf-8"))
    run["study"]["plugins"] = [{"file": "mine.py", "sha256": "0"}]
    path.write_text(json.dumps(run), encoding="utf-8")
    with pytest.raises(InputError, match=r"plug-in mine\.py"):
        load_study(path)


def test_shipped_studies_go_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert {"quickstart", "paper"} <= {path.stem for path in shipped_folder().glob("*.toml")}
    for given in ("quickstart", "quickstart.toml"):
        assert load_study(study_file(Path(given))).name == "quickstart"
    Path("quickstart.toml").write_text(STUDY, encoding="utf-8")
    assert study_file(Path("quickstart.toml")) == Path("quickstart.toml")
    with pytest.raises(InputError, match="quickstart"):
        study_file(Path("quickstat"))
    assert study_file(Path("other/quickstart.toml")) == Path("other/quickstart.toml")


def test_inputs_are_those_of_one_folder(study: Path, tmp_path: Path) -> None:
    """Each input is unchanged somewhere, but no folder contains both."""
    out = tmp_path / "out"
    path = remembered(study, out)
    run = json.loads(path.read_text(encoding="utf-8"))
    other = out / "other.csv"
    other.write_text("1,2\n", encoding="utf-8")
    run["inputs"] |= provenance({"other.csv": other})["inputs"]
    path.write_text(json.dumps(run), encoding="utf-8")
    with pytest.raises(InputError, match=r"the input file rig\.csv of the run is missing"):
        load_study(path)
    (out / "rig.csv").write_text("0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"rig\.csv has changed since the run"):
        load_study(path)
