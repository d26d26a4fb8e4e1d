"""Compiled kernels on disk: shared by processes, stored also without a writable folder, and limited in number."""

import os
import pickle
import sys
import time
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import build
from bayesdamp.physics.kernel.solve import SHIPPED, SHIPPED_LAWS, warm
from bayesdamp.physics.restoring import LAWS

SOLVE = """
import numpy as np
from bayesdamp.physics.kernel import Solver
s = Solver(("viscous",), "linear", np.linspace(0, 1, 5), "angle", 0.1, 4.0, 0.01, np.linspace(0, 1, 4))
print(s.solve(np.array([0.1, 16.0, 0.0, 0.1, 0.0]), np.ones(1, bool), tangents=0).y[-1])
march = s.kernel.march
print(sum(march.stats.cache_hits.values()), sum(march.stats.cache_misses.values()))
"""


def start(cache: Path) -> Popen[str]:
    env = os.environ | {"BAYESDAMP_CACHE": str(cache), "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return Popen([sys.executable, "-c", SOLVE], env=env, text=True, stdout=PIPE, stderr=PIPE)


def result_of(process: Popen[str]) -> tuple[float, tuple[int, int]]:
    """Return the motion's last value, and how often the kernel was loaded and compiled."""
    output, faults = process.communicate(timeout=600)
    assert process.returncode == 0, faults
    assert not faults
    value, counts = output.splitlines()
    hits, misses = counts.split()
    return float(value), (int(hits), int(misses))


@pytest.mark.slow
def test_processes_share_compiled_kernels(tmp_path: Path) -> None:
    """Two at once may both compile, and neither fails. A third loads the kernel."""
    both = [result_of(p) for p in [start(tmp_path), start(tmp_path)]]
    after = result_of(start(tmp_path))
    assert both[0][0] == both[1][0] == after[0]
    assert all(sum(counts) == 1 for _, counts in both)
    assert after[1] == (1, 0)
    assert not list(tmp_path.rglob("*.tmp*"))


def test_kernels_are_stored_in_a_temporary_folder_if_necessary(tmp_path, monkeypatch) -> None:
    """The folder cannot be created because a file has its name."""
    occupied = tmp_path / "file"
    occupied.write_text("")
    monkeypatch.setenv("BAYESDAMP_CACHE", str(occupied))
    path = build._store("bayesdamp_kernel_x", "a = 1\n")
    assert path.read_text() == "a = 1\n"
    assert tmp_path not in path.parents
    assert build._store("bayesdamp_kernel_x", "a = 1\n") == path


def test_the_oldest_kernels_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 60 kernels, 50 remain, among them 20 that were used within the last hour. Another folder is not touched."""
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path))
    home, now = tmp_path / "kernels", time.time()
    (home / "other").mkdir(parents=True)
    for i in range(60):
        folder = home / f"bayesdamp_kernel_{i:02d}"
        folder.mkdir()
        (folder / "kernel.py").write_text("")
        old = now - (60.0 if i < 20 else 1e6 + i)
        os.utime(folder, (old, old))
    build._store("bayesdamp_kernel_new", "a = 1\n")
    left = {folder.name for folder in home.iterdir()}
    assert len(left - {"other"}) == build.MAX_STORED
    assert {f"bayesdamp_kernel_{i:02d}" for i in range(20)} <= left
    assert {"other", "bayesdamp_kernel_new"} <= left
    assert "bayesdamp_kernel_59" not in left


def test_warm_compiles_the_terms_and_laws_of_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, kernel = [], build.kernel_of(SHIPPED, SHIPPED_LAWS)
    kernel_of = "bayesdamp.physics.kernel.solve.kernel_of"
    monkeypatch.setattr(kernel_of, lambda *args: calls.append(args) or kernel)
    warm()
    assert calls == [(SHIPPED, SHIPPED_LAWS)]
    assert len(kernel.march.signatures) == 1
    assert pickle.loads(pickle.dumps(kernel)).terms == kernel.terms, "a pickled fit contains it"
    assert len(kernel.sums.signatures) == 1


def test_one_kernel_contains_the_terms_and_laws_of_the_package() -> None:
    assert sorted(SHIPPED) == sorted(name for name in TERMS.names() if TERMS.ships(name))
    assert sorted(SHIPPED_LAWS) == sorted(name for name in LAWS.names() if LAWS.ships(name))
