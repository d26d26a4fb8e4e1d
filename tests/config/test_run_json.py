"""A run.json is read as the study of its run, or refused with the reason; shipped studies have names."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.config import load_study
from bayesdamp.config.load import record_question, shipped_folder, study_file
from bayesdamp.store.results import provenance
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


@pytest.fixture
def run_json(study: Path, tmp_path: Path) -> Path:
    """The run.json of the study, without the run's other files."""
    loaded = load_study(study)
    inputs = provenance({"rig.csv": study.with_name("rig.csv")})["inputs"]
    path = tmp_path / "out" / "run.json"
    path.parent.mkdir()
    content = {"name": loaded.name, "study": loaded.resolved(), "inputs": inputs}
    path.write_text(json.dumps({**content, "asked": record_question(loaded, path.parent)}), encoding="utf-8")
    return path


def test_a_run_json_is_read_as_its_study(study: Path, run_json: Path) -> None:
    """Also if the record is now in the folder of the run."""
    assert load_study(run_json).resolved() == load_study(study).resolved()
    file = run_json.with_name("rig.csv")
    shutil.move(study.with_name("rig.csv"), file)
    assert load_study(run_json).signals[1].source.path == file  # type: ignore[union-attr]


def test_a_changed_or_missing_input_file_is_refused(study: Path, run_json: Path) -> None:
    study.with_name("rig.csv").write_text("0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"run\.json: rig\.csv has changed since the run"):
        load_study(run_json)
    study.with_name("rig.csv").unlink()
    with pytest.raises(InputError, match=r"the input file rig\.csv of the run is missing"):
        load_study(run_json)


def test_a_missing_plug_in_is_named(run_json: Path) -> None:
    run = json.loads(run_json.read_text(encoding="utf-8"))
    run["study"]["plugins"] = [{"file": "mine.py", "sha256": "0"}]
    run_json.write_text(json.dumps(run), encoding="utf-8")
    with pytest.raises(InputError, match=r"plug-in mine\.py"):
        load_study(run_json)


def test_shipped_studies_are_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert {"quickstart", "paper"} <= {path.stem for path in shipped_folder().glob("*.toml")}
    for name in ("quickstart", "quickstart.toml"):
        assert load_study(study_file(Path(name))).name == "quickstart"
    Path("quickstart.toml").write_text(STUDY, encoding="utf-8")
    assert study_file(Path("quickstart.toml")) == Path("quickstart.toml")
    with pytest.raises(InputError, match="quickstart"):
        study_file(Path("quickstat"))
    assert study_file(Path("other/quickstart.toml")) == Path("other/quickstart.toml")


def test_inputs_are_those_of_one_folder(run_json: Path) -> None:
    """Each input is unchanged somewhere, but no folder contains both."""
    run, other = json.loads(run_json.read_text(encoding="utf-8")), run_json.with_name("other.csv")
    other.write_text("1,2\n", encoding="utf-8")
    run["inputs"] |= provenance({"other.csv": other})["inputs"]
    run_json.write_text(json.dumps(run), encoding="utf-8")
    with pytest.raises(InputError, match=r"the input file rig\.csv of the run is missing"):
        load_study(run_json)
    run_json.with_name("rig.csv").write_text("0,1\n1,2\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"rig\.csv has changed since the run"):
        load_study(run_json)
