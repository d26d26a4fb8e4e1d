"""Write a kernel, which is compiled once and stored on disk: the forces of an oscillator, then the templates."""

from __future__ import annotations

import ast
import atexit
import hashlib
import importlib.util
import inspect
import os
import shutil
import sys
import tempfile
import textwrap
import time
import uuid
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

from bayesdamp.machine import cache_folder
from bayesdamp.physics.damping import EXACT, TERMS, TINY, DampingTerm
from bayesdamp.physics.kernel.differentiate import NoSlopeError, differenced, differentiated
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import Refusal

TEMPLATES, END = ("tangents", "march"), "# --- end ---"
MOST_KEPT = 50
"""Kernels on disk, 0.6 MB each, beyond which those that were not used for longest are removed (conventional)."""
USUAL = 3
"""Number of damping terms, the first ones, that are tested one by one at each point; of the others, whether any acts
is tested once."""
IN_USE = 3600.0
"""Time in s after its last use in which another process may still be compiling a kernel (conventional)."""
_HEAD = f"""import math

import numpy as np
from numba import njit


EXACT, TINY = {EXACT!r}, {TINY!r}


@njit
def _tanh(y):
    return 1.0 - 2.0 / (math.exp(2.0 * y) + 1.0)
"""
_STAMP = (1_000_000_000, 1_000_000_000)
"""Time of every module's file: Numba compiles a file of another time again, and two processes may write it at once."""


@dataclass(frozen=True)
class Kernel:
    """Compiled functions of an oscillator with all of `terms`, any of which may be off, under one of `laws`."""

    terms: tuple[str, ...]
    laws: tuple[str, ...]
    march: Callable[..., Any]
    sums: Callable[..., Any]


def kernel_of(terms: tuple[str, ...], laws: tuple[str, ...]) -> Kernel:
    """Return the kernel of damping terms and restoring laws, by their names; it is compiled when it is first called.

    Raises Refusal where a term or law of a user has no `kernel`, or none of which the source is known.
    """
    return _kernel_of(terms, laws, tuple(map(TERMS.get, terms)), tuple(map(LAWS.get, laws)))


@lru_cache(maxsize=64)
def _kernel_of(terms: tuple[str, ...], laws: tuple[str, ...], *_registered: object) -> Kernel:
    """Return a kernel; a name that is registered again, with another force, gets another one."""
    module = _module(source_of(terms, laws))
    return Kernel(terms, laws, module.march, module.sums)


def most_parameters(laws: tuple[str, ...]) -> int:
    """Return the number of parameters of the law that has most."""
    return max(len(LAWS.get(name).parameters) for name in laws)


def source_of(terms: tuple[str, ...], laws: tuple[str, ...]) -> str:
    """Return the source of a kernel's module."""
    parts, calls, sums, slopes, at = [_HEAD], list[str](), list[str](), list[str](), 0
    owners, switches, jumps = list[int](), list[bool](), list[bool]()
    for number, name in enumerate(terms):
        term = TERMS.get(name)
        parts.append(_function(term, DampingTerm, f"_shape_{number}", f"damping term {name!r}"))
        further = [f"q[{at + i}]" for i in range(len(term.further))]
        inside = ", ".join(["x", "v", "rounding" if term.rounded else "epsilon", *further])
        slope, changes = _slopes_of_term(parts[-1], number, len(further))
        parts.append(slope)
        owners += [number] * len(further)
        switches.append(bool(term.switches))
        jumps.append(bool(term.switches and not term.rounded))
        if number == USUAL:
            sums.append(f"if c[{len(terms)}] != 0.0:")
            slopes.append(sums[-1])
        margin, c = "" if number < USUAL else "    ", f"c[{number}]"
        sums += [f"{margin}if {c} != 0.0:", f"{margin}    total += {c} * _shape_{number}({inside})"]
        calls.append(f"out[{number}] = _shape_{number}({inside}) if active[{number}] else 0.0")
        by_further = [f"by_{i}" for i in range(len(further))]
        slopes += [
            f"{margin}if active[{number}]:",
            f"{margin}    {', '.join(['f', 'by_x', 'by_v', *by_further])} = _slopes_{number}({inside}{changes})",
            f"{margin}    out[{2 + number}] = share * f",
            f"{margin}    total, x_slope, v_slope = (total + {c} * f, x_slope + {c} * by_x, v_slope + {c} * by_v)",
            *(
                f"{margin}    out[{2 + len(terms) + at + i}] = share * {c} * {slope}"
                for i, slope in enumerate(by_further)
            ),
        ]
        at += len(further)
    others = " or ".join(f"active[{i}]" for i in range(USUAL, len(terms))) or "False"
    acting = [f"coefficients[{i}] if active[{i}] else 0.0" for i in range(len(terms))]
    further, rests = [f"q[{i}]" for i in range(at)], [f"law[{i}]" for i in range(most_parameters(laws) + 1)]
    tuples = ", ".join(
        f"({', '.join(each)})" for each in ([*acting, f"1.0 if {others} else 0.0"], [*further, "0.0"], rests)
    )
    parts += [
        f"OWNERS = np.array({owners}, np.int64)\nSWITCHES = np.array({switches}, np.bool_)\n",
        f"JUMPS = np.array({jumps}, np.bool_)\n",
        _njit("shapes(x, v, epsilon, rounding, q, active, out)", *calls),
        _njit("damping(x, v, epsilon, rounding, q, c)", "total = 0.0", *sums, "return total"),
        _njit(
            "damping_slopes(x, v, epsilon, rounding, q, c, active, sizes, share, out)",
            "total, x_slope, v_slope = 0.0, 0.0, 0.0",
            *slopes,
            "return total, x_slope, v_slope",
        ),
        *_sources_of_laws(laws),
        _njit("gathered(coefficients, q, active, law)", f"return {tuples}"),
    ]
    for name in TEMPLATES:
        template = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
        parts.append(template[template.index(f"# --- {name} ---") : template.index(END)])
    return "\n\n".join(parts)


def _njit(signature: str, *lines: str) -> str:
    """Return the source of a compiled function."""
    return "".join([f"@njit\ndef {signature}:\n", *(f"    {line}\n" for line in lines)])


def _slopes_of_term(source: str, number: int, further: int) -> tuple[str, str]:
    """Return the function of a term's value and slopes by x, v and its parameters, and a call's other arguments."""
    given, name = _arguments(source), f"_slopes_{number}"
    try:
        return differentiated(source, name, [*given[:2], *given[3:]]), ""
    except NoSlopeError:
        q = [f"q{i}" for i in range(further)]
        call = f"_shape_{number}({{x}}, {{v}}, epsilon{''.join(f', {{{seed}}}' for seed in q)})"
        changes = {"x": "1e-6 * sizes[0]", "v": "1e-6 * sizes[1]"}
        changes |= {seed: f"1e-6 * (abs({seed}) + 1e-3)" for seed in q}
        return differenced(call, ["x", "v", "epsilon", *q, "sizes"], changes, name), ", sizes"


def _sources_of_laws(laws: tuple[str, ...]) -> list[str]:
    """Return the functions of the laws, and `restoring` and `restoring_slopes`, which choose among them.

    A law is chosen by its number, which is behind the parameters.
    """
    sizes = [len(LAWS.get(name).parameters) for name in laws]
    parts = [f"LAW_SIZES = np.array({sizes}, np.int64)\n"]
    for number, name in enumerate(laws):
        law = LAWS.get(name)
        parts.append(_function(law, RestoringLaw, f"_law_{number}", f"restoring law {name!r}"))
        parts += _slopes_of_law(parts[-1], number, len(law.parameters))
    for name, arguments in (("restoring", "x, p"), ("restoring_slopes", "x, p, sizes, share, out, first")):
        each = "_law" if name == "restoring" else "_slopes_of_law"
        lines: list[str] = []
        for number in range(len(laws) - 1):
            lines += [f"if p[{max(sizes)}] == {number}.0:", f"    return {each}_{number}({arguments})"]
        parts.append(_njit(f"{name}({arguments})", *lines, f"return {each}_{len(laws) - 1}({arguments})"))
    return parts


def _slopes_of_law(source: str, number: int, count: int) -> list[str]:
    """Return the function of a law's value and slopes by x, which writes those by its parameters, and what it calls."""
    x, p = _arguments(source)
    name = f"_numbers_of_law_{number}"
    try:
        own, changes = differentiated(source, name, [x, *(f"{p}[{i}]" for i in range(count))]), ""
    except NoSlopeError:
        numbers = [f"p{i}" for i in range(count)]
        call = f"_law_{number}({{x}}, ({', '.join(f'{{{seed}}}' for seed in numbers)}, 0.0))"
        moved = {"x": "1e-6 * sizes[0]"}
        moved |= {seed: f"1e-6 * (abs({seed}) + sizes[{2 + i}])" for i, seed in enumerate(numbers)}
        inner = differenced(call, ["x", *numbers, "sizes"], moved, f"{name}_moved")
        given = ", ".join(["x", *(f"p[{i}]" for i in range(count)), "sizes"])
        own = f"{inner}\n\n{_njit(f'{name}(x, p, sizes)', f'return {name}_moved({given})')}"
        changes = ", sizes"
    by_parameters = [f"by_{i}" for i in range(count)]
    return [
        own,
        _njit(
            f"_slopes_of_law_{number}(x, p, sizes, share, out, first)",
            f"{', '.join(['f', 'by_x', *by_parameters])} = {name}(x, p{changes})",
            *(f"out[first + {i}] = share * {slope}" for i, slope in enumerate(by_parameters)),
            "return f, by_x",
        ),
    ]


def _arguments(source: str) -> list[str]:
    """Return the names of the arguments of a function from its source."""
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    return [a.arg for a in (*function.args.posonlyargs, *function.args.args)]


@lru_cache(maxsize=256)
def _function(plugin: DampingTerm | RestoringLaw, base: type, name: str, what: str) -> str:
    """Return the source of a plug-in's `kernel` as a compiled function of another name.

    Annotations and defaults are removed, because they name what the kernel's module does not import. The hyperbolic
    tangent becomes one by an exponential, in a third of the time: right to 2e-16 of its largest value.
    """
    function = plugin.kernel
    if type(plugin).kernel is base.kernel:  # type: ignore[attr-defined]
        raise Refusal(f"the {what} has no `kernel`, of which compiled trajectories are made")
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    except (OSError, SyntaxError):
        raise Refusal(f"the {what} has a `kernel` whose source cannot be read") from None
    definition = tree.body[0]
    if not isinstance(definition, ast.FunctionDef):
        raise Refusal(f"the {what} has a `kernel` that is not a plain function")
    foreign = sorted(set(function.__code__.co_names) & set(function.__globals__) - {"math", "np"})
    if foreign:
        raise Refusal(
            f"the {what} has a `kernel` that uses {foreign[0]!r}: it may use its arguments, math and np"
        )
    definition.name, definition.returns = name, None
    definition.decorator_list = [ast.Name("njit", ast.Load())]
    for argument in [*definition.args.posonlyargs, *definition.args.args]:
        argument.annotation = None
    definition.args.defaults = []
    return ast.unparse(ast.fix_missing_locations(definition)).replace("math.tanh(", "_tanh(") + "\n"


@lru_cache(maxsize=64)
def _module(text: str) -> ModuleType:
    """Import the module with this source from the folder that contains it and its machine code."""
    name = f"bayesdamp_kernel_{hashlib.sha256(text.encode()).hexdigest()[:20]}"
    spec = importlib.util.spec_from_file_location(name, _kept(name, text))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _kept(name: str, text: str) -> Path:
    """Return the module's file in a folder of its own: in the user's cache, or else in a temporary one.

    From the cache, the kernels that were not used for longest are removed, but never those in use.
    """
    home = cache_folder() / "kernels"
    try:
        path = _written(home / name, text)
        folders = sorted(home.glob("bayesdamp_kernel_*"), key=lambda folder: folder.stat().st_mtime)
        for folder in folders[: max(len(folders) - MOST_KEPT, 0)]:
            if time.time() - folder.stat().st_mtime > IN_USE:
                shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        path = _written(_temporary() / name, text)
    return path


def _written(folder: Path, text: str) -> Path:
    """Write the source in one step, because two processes may do so at once; the folder's time is its last use."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "kernel.py"
    if not path.is_file():
        partial = folder / f".{uuid.uuid4().hex}.tmp"
        partial.write_text(text, encoding="utf-8")
        os.utime(partial, _STAMP)
        partial.replace(path)
    os.utime(folder)
    if not os.access(folder, os.W_OK):
        raise PermissionError(f"{folder} is not writable")
    return path


@cache
def _temporary() -> Path:
    """Return a folder of this process for kernels that cannot be stored elsewhere."""
    folder = Path(tempfile.mkdtemp(prefix="bayesdamp-kernels-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
