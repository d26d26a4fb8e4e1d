"""Programs that are kept: what the next process finds is what was traced, and nothing that has changed since."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import pytest
from jax import numpy as jnp

from bayesdamp import plugins, programs
from bayesdamp.inference.compiled import compiled
from bayesdamp.inference.target import Target
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal
from bayesdamp.programs import Program, keep_in
from bayesdamp.types import Signal

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
        monkeypatch.setattr(programs, "__file__", str(tmp_path / "programs.py"))
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


def test_nothing_is_kept_of_a_user_s_plug_in(kept: Path) -> None:
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


def test_layouts_that_differ_in_a_prior_alone_do_not_share(kept: Path) -> None:
    """The posterior of one record under two kinds of prior, each as it is without anything kept."""
    t = np.linspace(0.0, 3.0, 40)
    osc, known = Oscillator(("viscous",), "linear"), {"stiffness": 20.0, "rest_angle": 0.0, "omega0": 0.0}
    values = {**known, "zeta": 0.1, "theta0": 0.3}
    signal = Signal(t, np.exp(-0.1 * t) * 0.3 * np.cos(np.sqrt(20.0) * t), "angle")
    plan = make_plan(osc, values, t)

    def density() -> list[float]:
        found = []
        for prior in (HalfNormal(scale=0.2), LogNormal(median=0.2, sigma=1.0)):
            target = Target(
                signal, osc, "gaussian", {"zeta": prior}, {**known, "theta0": 0.3, "noise_sd": 0.01}
            )
            compiled.cache_clear()
            found.append(float(compiled(target.layout).batch(target.context(plan), np.array([[0.5]] * 3))[0]))
        return found

    first, second = density(), density()
    keep_in(None)
    assert density() == first == second
    assert first[0] != first[1]
