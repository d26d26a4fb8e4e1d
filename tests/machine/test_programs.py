"""Programs that are kept: what the next process finds is what was traced, and nothing that has changed since."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest
from jax import numpy as jnp

from bayesdamp import plugins
from bayesdamp.machine import programs
from bayesdamp.machine.programs import Program, keep_in

X = np.linspace(0.0, 1.0, 7)


@pytest.fixture(autouse=True)
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(plugins, "_EXTENDED", [])
    keep_in(tmp_path)
    yield tmp_path
    keep_in(None)


def files(folder: Path) -> set[Path]:
    return set(folder.glob("*"))


def test_the_next_process_starts_from_the_trace(kept: Path) -> None:
    """Another function under the same name and the same parts is not traced at all: what was kept is run."""
    np.testing.assert_array_equal(Program(jnp.sin, "wave", "a")(X), jnp.sin(X))
    assert len(files(kept)) == 1
    again = Program(jnp.cos, "wave", "a")
    np.testing.assert_array_equal(again(X), jnp.sin(X))
    np.testing.assert_array_equal(again(X), again(X))


@pytest.mark.parametrize("changed", ["name", "parts", "code", "shape", "type"])
def test_whatever_it_depends_on_makes_another(
    changed: str, kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Program(jnp.sin, "wave", "a")(X)
    x = {"shape": X[:3], "type": X.astype(np.float32)}.get(changed, X)
    if changed == "code":
        monkeypatch.setattr(programs, "_here", lambda: "other code")
    other = Program(jnp.cos, "other" if changed == "name" else "wave", "b" if changed == "parts" else "a")
    np.testing.assert_array_equal(other(x), jnp.cos(x))
    assert len(files(kept)) == 2


def test_the_code_is_the_package_s(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A letter in any module changes what programs are kept under."""
    found = []
    for text in ("x = 1", "x = 2"):
        (tmp_path / "inside").mkdir(exist_ok=True)
        (tmp_path / "inside" / "law.py").write_text(text)
        monkeypatch.setattr(programs, "__file__", str(tmp_path / "machine" / "programs.py"))
        programs._here.cache_clear()
        found.append(programs._here())
    programs._here.cache_clear()
    assert found[0] != found[1]


@pytest.mark.parametrize("content", [b"", b"no program", None])
def test_a_file_that_is_none_is_written_anew(content: bytes | None, kept: Path) -> None:
    Program(jnp.sin, "wave")(X)
    (path,) = files(kept)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] if content is None else content)
    np.testing.assert_array_equal(Program(jnp.sin, "wave")(X), jnp.sin(X))
    np.testing.assert_array_equal(Program(jnp.cos, "wave")(X), jnp.sin(X))  # from the file again


def test_nothing_is_kept_of_a_user_s_plug_in(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # A registry takes the place of the one that its package has; what follows needs that one.
    monkeypatch.setattr(plugins, "_REGISTRIES", dict(plugins._REGISTRIES))
    plugins.Registry("bayesdamp.physics.damping", "damping term").add("mine", object())
    np.testing.assert_array_equal(Program(jnp.sin, "wave")(X), jnp.sin(X))
    assert not files(kept)


def test_inside_another_program_it_is_traced_with_it(kept: Path) -> None:
    wave = Program(jnp.sin, "wave")
    np.testing.assert_allclose(jax.vmap(jax.grad(wave))(jnp.asarray(X)), np.cos(X), rtol=1e-14)
    assert not files(kept)


def test_a_folder_that_cannot_be_written_is_no_fault(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    keep_in(tmp_path / "file" / "below")
    np.testing.assert_array_equal(Program(jnp.sin, "wave")(X), jnp.sin(X))


ONE = """
import sys, time
from pathlib import Path
import numpy as np
from jax import numpy as jnp
from bayesdamp.machine.programs import Program, keep_in
from bayesdamp.pipeline.workers import cache_compilations

def function(x):
    with Path("traces").open("a") as file:
        file.write("traced\\n")
    time.sleep(1.0)
    for k in range(1, 30):
        x = jnp.cumsum(jnp.sin(k * x))
    return x

cache_compilations()
Path("ready" + sys.argv[1]).touch()
while len(list(Path().glob("ready*"))) < int(sys.argv[3]):
    time.sleep(0.01)
print(Program(function, sys.argv[2])(np.arange(5.0)).sum())
"""


def together(folder: Path, names: list[str], cache: str) -> list[str]:
    """What processes print that run a program at the same time, one for each name."""
    for path in folder.glob("ready*"):
        path.unlink()
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder / cache)}
    running = [
        subprocess.Popen(
            [sys.executable, "-c", ONE, str(k), name, str(len(names))],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        for k, name in enumerate(names)
    ]
    found = [one.communicate()[0] for one in running]
    assert all(one.returncode == 0 for one in running)
    return found


def traces(folder: Path) -> int:
    return len((folder / "traces").read_text().splitlines())


def test_processes_that_need_one_program_at_once_make_it_once(tmp_path: Path) -> None:
    """Negative control: of two names each is made."""
    first, second = together(tmp_path, ["wave", "wave"], "cache")
    assert first == second
    assert traces(tmp_path) == 1
    together(tmp_path, ["one", "other"], "cache")
    assert traces(tmp_path) == 3
    assert not list((tmp_path / "cache" / "bayesdamp").rglob("*.lock"))


def kept_in(folder: Path) -> set[str]:
    """The compiled programs in a cache; what JAX itself compiles beside them is kept only where that took it long."""
    return {path.name for path in folder.rglob("jit_call-*-cache")}


def test_a_cache_that_was_copied_is_found_again(tmp_path: Path) -> None:
    """Its programs are neither traced nor compiled: nothing is added. Negative control: another program is."""
    together(tmp_path, ["wave"], "cache")
    shutil.copytree(tmp_path / "cache", tmp_path / "copy")
    before = kept_in(tmp_path / "copy")
    assert before
    together(tmp_path, ["wave"], "copy")
    assert kept_in(tmp_path / "copy") == before
    assert traces(tmp_path) == 1
    together(tmp_path, ["other"], "copy")
    assert traces(tmp_path) == 2


def test_a_wait_that_is_long_ends(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lock of a process that hangs is no reason to hang."""
    monkeypatch.setattr(programs, "PATIENCE", 0.05)
    Program(jnp.sin, "wave")(X)
    (path,) = files(kept)
    path.unlink()
    with programs.FileLock(path.with_suffix(".lock")):
        np.testing.assert_array_equal(Program(jnp.sin, "wave")(X), jnp.sin(X))


def test_who_traces_a_program_runs_what_everybody_reads(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not the trace itself: what is compiled of it need not add up in the same order."""
    read: list[int] = []
    called = programs._called
    monkeypatch.setattr(programs, "_called", lambda content: read.append(len(content)) or called(content))
    first = Program(jnp.cumsum, "sums", "a")(X)
    assert len(read) == 1
    np.testing.assert_array_equal(Program(jnp.cumsum, "sums", "a")(X), first)
    assert read[0] == read[1]
