"""A study that is killed at random moments and whose files are damaged ends with the tables of one undisturbed."""

import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.studies import SYSTEM, signal_text, study_text, tables_of

KILLS = int(os.environ.get("KILLS", "50"))
SEED = int(os.environ.get("KILLS_SEED", "5"))
DAMAGED = 3
"""Number of stored results that are overwritten, emptied or cut off."""
SIMULATE = "duration = 10.0, samples = 300, noise_sd = 0.003"
STUDY = study_text(
    'estimators = { use = ["least_squares", "envelope"] }',
    'models = { compare = ["viscous", "quadratic", "viscous+quadratic"] }',
    'posterior = { samplers = ["nuts", "emcee"], chains = 2, warmup = 200, draws = 400 }',
    simulate=f"viscous = 0.05, {SIMULATE}",
    system=f"{SYSTEM}, epsilon = 0.0",
) + signal_text("other", f"viscous = 0.03, quadratic = 0.04, {SIMULATE}")


def command(folder: Path, workers: int, seed: int = 1) -> list[str]:
    file = folder / "killed.toml"
    file.write_text(STUDY.replace("seed = 3", f"seed = {seed}"), encoding="utf-8")
    options = ("--out", str(folder / "out"), "--workers", str(workers), "--quiet")
    return [sys.executable, "-m", "bayesdamp", "study", str(file), *options]


@dataclass(frozen=True)
class Undisturbed:
    """The tables and the duration (s) of a run without kills."""

    tables: dict[str, list[str]]
    seconds: float


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    start = time.monotonic()
    assert subprocess.run(command(folder, 2), stdout=subprocess.DEVNULL).returncode == 0
    return Undisturbed(tables_of(folder / "out"), time.monotonic() - start)


def damage(out: Path, rng: np.random.Generator) -> bool:
    """Damage one stored result; return whether one was stored."""
    paths = sorted(out.glob("cells/**/*.npz"))
    if not paths:
        return False
    path = paths[rng.integers(len(paths))]
    whole = path.read_bytes()
    path.write_bytes((b"", whole[: len(whole) // 2], bytes(len(whole)))[rng.integers(3)])
    return True


@pytest.mark.slow
def test_a_study_killed_at_random_has_the_same_tables(undisturbed: Undisturbed, tmp_path: Path) -> None:
    rng = np.random.default_rng(SEED)
    killed, whole, damaged = 0, 0, 0
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    while killed < KILLS or not whole:
        run = subprocess.Popen(command(tmp_path, int(rng.integers(1, 3))), start_new_session=True, **quiet)
        try:
            status = run.wait(timeout=float(rng.uniform(0, undisturbed.seconds)) if killed < KILLS else None)
        except subprocess.TimeoutExpired:
            os.killpg(run.pid, signal.SIGKILL)
            run.wait()
            killed += 1
            damaged += damaged < DAMAGED and damage(tmp_path / "out", rng)
            continue
        assert status == 0
        assert tables_of(tmp_path / "out") == undisturbed.tables, f"{killed} kills, {damaged} damaged files"
        whole += 1
        shutil.rmtree(tmp_path / "out")
    assert damaged == min(DAMAGED, KILLS)


@pytest.mark.slow
def test_another_seed_gives_other_tables(undisturbed: Undisturbed, tmp_path: Path) -> None:
    """Control of the test above."""
    assert subprocess.run(command(tmp_path, 2, seed=2), stdout=subprocess.DEVNULL).returncode == 0
    assert tables_of(tmp_path / "out") != undisturbed.tables
