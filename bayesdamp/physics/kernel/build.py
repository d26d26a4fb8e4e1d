"""Generate the source of a kernel, compile it, and store it on disk.

A kernel is a module of functions that integrate an oscillator's equation of motion. Its source consists of the forces
of the oscillator and their derivatives, followed by the template modules `tangents` and `march`.

The source of the derivatives is generated from that of the forces by forward-mode automatic differentiation
(A. Griewank and A. Walther, Evaluating Derivatives, 2008, ch. 3): each elementary function is evaluated once and used
for the value and for all derivatives.
"""

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
from bayesdamp.physics.restoring import LAWS, RestoringLaw
from bayesdamp.types import Refusal

SLOPES = {
    "sin": "math.cos({a})",
    "cos": "-math.sin({a})",
    "tan": "1.0 + {f} * {f}",
    "tanh": "1.0 - {f} * {f}",
    "exp": "{f}",
    "log": "1.0 / {a}",
    "sqrt": "0.5 / {f} if {f} != 0.0 else 0.0",
    "atan": "1.0 / (1.0 + {a} * {a})",
    "arctan": "1.0 / (1.0 + {a} * {a})",
    "sinh": "math.cosh({a})",
    "cosh": "math.sinh({a})",
    "abs": "1.0 if {a} >= 0.0 else -1.0",
    "fabs": "1.0 if {a} >= 0.0 else -1.0",
}
"""For each elementary function f(a), the source text of its derivative, in which {a} stands for the argument and {f}
for the value."""


class NoSlopeError(Exception):
    """Exception for a function whose source contains an operation that this module cannot differentiate."""


def derivative_source(source: str, name: str, seeds: list[str]) -> str:
    """Return the source of a function `name` that returns the value of a given function and its derivatives.

    source: source of the given function. seeds: variables by which it is differentiated: arguments, or items of an
    argument such as `p[0]`. The new function has the same arguments and a last argument `_sizes`, which it does not use
    (functions from `difference_source` need it). It returns a tuple: the value, then one derivative for each seed.
    Raises NoSlopeError unless the given function consists of assignments to names and a return, in operations that this
    module knows.
    """
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    arguments = [a.arg for a in (*function.args.posonlyargs, *function.args.args)]
    lines = _Lines(seeds, arguments)
    for statement in function.body:
        if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
            continue  # docstring
        match statement:
            case ast.Assign(targets=[ast.Name(id=target)]):
                lines.known[target] = lines.of(statement.value)
            case ast.Return(value=ast.expr() as value):
                returned_value, slopes = lines.of(value)
                returned = ", ".join([returned_value, *(slopes.get(seed, "0.0") for seed in seeds)])
                lines.text.append(f"return {returned}")
                body = "".join(f"    {line}\n" for line in lines.text)
                return f"@njit\ndef {name}({', '.join([*arguments, '_sizes'])}):\n{body}"
            case _:
                break
    raise NoSlopeError


class _Lines:
    """Builder of a function body in which each line is one operation on names and numbers.

    A value is represented by a pair: the text of its name or number, and a dictionary of the texts of its derivatives.
    The keys of the dictionary are the seeds, which are the variables of differentiation, on which the value depends.
    """

    def __init__(self, seeds: list[str], arguments: list[str]) -> None:
        self.text: list[str] = []
        self.seeds = seeds
        self.known = {a: (a, {a: "1.0"} if a in seeds else {}) for a in arguments}

    def of(self, node: ast.expr) -> tuple[str, dict[str, str]]:
        """Append lines that evaluate an expression; return the texts of its value and, by seed, of its derivatives.

        Raises NoSlopeError if the expression cannot be differentiated here.
        """
        match node:
            case ast.Constant(value=int() | float() as number):
                return repr(float(number)), {}
            case ast.Name(id=name) if name in self.known:
                return self.known[name]
            case ast.Subscript() if ast.unparse(node) in self.seeds:
                return ast.unparse(node), {ast.unparse(node): "1.0"}
            case ast.Attribute(value=ast.Name(id="math" | "np"), attr="pi"):
                return "math.pi", {}
            case ast.UnaryOp(op=ast.USub(), operand=inner):
                value, slopes = self.of(inner)
                return self._new(f"-{value}"), self._chain([("-1.0", slopes)])
            case ast.BinOp(left=left, op=op, right=right):
                (a, by_a), (b, by_b) = self.of(left), self.of(right)
                match op:
                    case ast.Add():
                        return self._new(f"{a} + {b}"), self._chain([("1.0", by_a), ("1.0", by_b)])
                    case ast.Sub():
                        return self._new(f"{a} - {b}"), self._chain([("1.0", by_a), ("-1.0", by_b)])
                    case ast.Mult():
                        return self._new(f"{a} * {b}"), self._chain([(b, by_a), (a, by_b)])
                    case ast.Div():
                        f, over = self._new(f"{a} / {b}"), self._new(f"1.0 / {b}")
                        return f, self._chain([(over, by_a), (f"-{f} * {over}", by_b)])
                    case ast.Pow() if b == "2.0":
                        return self._new(f"{a} * {a}"), self._chain([(f"2.0 * {a}", by_a)])
                    case ast.Pow():
                        f = self._new(f"{a} ** {b}")
                        slope = f"{b} * {f} / {a} if {a} != 0.0 else 0.0"
                        if b.replace(".", "").isdigit():
                            slope = f"{b} * {a} ** ({b} - 1.0)"
                        by_power = f"{f} * math.log({a}) if {a} > 0.0 else 0.0"
                        return f, self._chain([(slope, by_a), (by_power, by_b)])
            case ast.Call(func=called, args=[_, *_] as given, keywords=[]):
                text, arguments = ast.unparse(called), [self.of(argument) for argument in given]
                name, (a, by_a) = text.split(".")[-1].lstrip("_"), arguments[0]
                f = self._new(f"{text}({', '.join(value for value, _ in arguments)})")
                if name in SLOPES and len(given) == 1:
                    return f, self._chain([(SLOPES[name].format(a=a, f=f), by_a)])
                if text in ("max", "min") and len(given) == 2:
                    first = self._new(f"1.0 if {f} == {a} else 0.0")
                    return f, self._chain([(first, by_a), (f"1.0 - {first}", arguments[1][1])])
        raise NoSlopeError

    def _new(self, text: str) -> str:
        name = f"_s{len(self.text)}"
        self.text.append(f"{name} = {text}")
        return name

    def _chain(self, parts: list[tuple[str, dict[str, str]]]) -> dict[str, str]:
        """Append the lines of the chain rule for one operation; return the texts of its derivatives, by seed.

        A seed is a variable of differentiation. parts: for each argument of the operation, the text of the partial
        derivative of the result by this argument, and the texts of the argument's derivatives by seed. The derivative
        by a seed is the sum of the products of these two.
        """
        slopes_by_seed: dict[str, str] = {}
        for factor, slopes in parts:
            if not slopes:
                continue
            plain = factor if factor in ("1.0", "-1.0") or factor.isidentifier() else self._new(factor)
            for seed, slope in slopes.items():
                if "1.0" in (plain, slope):
                    term = slope if plain == "1.0" else plain
                else:
                    term = self._new(f"{plain} * {slope}")
                slopes_by_seed[seed] = (
                    self._new(f"{slopes_by_seed[seed]} + {term}") if seed in slopes_by_seed else term
                )
        return slopes_by_seed


def difference_source(call: str, arguments: list[str], steps: dict[str, str], name: str) -> str:
    """Return the source of a function `name` that returns a value and its derivatives by central differences.

    call: text of an expression that computes the value, with {} in the place of each variable of differentiation
    (seed). arguments: names of the arguments of the new function. steps: for each seed, in the order of `call`, the
    text of the step of its difference quotient. The function returns a tuple: the value, then one derivative for each
    seed.
    """
    seeds = list(steps)
    lines, returned = [], [call.format(*seeds)]
    for i, (seed, change) in enumerate(steps.items()):
        high, low = (call.format(*seeds[:i], f"{seed} {sign} _d{i}", *seeds[i + 1 :]) for sign in "+-")
        lines += [f"_d{i} = {change}", f"_slope{i} = ({high} - {low}) / (2.0 * _d{i})"]
        returned.append(f"_slope{i}")
    body = "".join(f"    {line}\n" for line in [*lines, f"return {', '.join(returned)}"])
    return f"@njit\ndef {name}({', '.join(arguments)}):\n{body}"


TEMPLATES, END = ("tangents", "march"), "# --- end ---"
"""Names of the template modules of this folder, part of whose source is copied into each kernel, and the comment line
at which this part ends in each of them."""
MAX_STORED = 50
"""Greatest number of kernels on disk (0.6 MB each); the least recently used are removed first (conventional)."""
USUAL_TERMS = 3
"""Number of damping terms, the first ones in a kernel, that are expected to be on often. The generated code tests each
of them. One common test skips the later terms if they are all off."""
IN_USE_SECONDS = 3600.0
"""A kernel on disk that was last used less than this time ago (s) is not removed, because another process may be
compiling it (conventional)."""
# First lines of each kernel's source.
_HEAD = f"""import math

import numpy as np
from numba import njit

# For functions that only other compiled functions call. Wrappers for calls from Python take a fifth of the time to
# compile.
inner = njit(no_cpython_wrapper=True, no_cfunc_wrapper=True)


EXACT, TINY = {EXACT!r}, {TINY!r}


@njit
def _tanh(y):
    return 1.0 - 2.0 / (math.exp(2.0 * y) + 1.0)
"""
_STAMP = (1_000_000_000, 1_000_000_000)
"""Access and modification time (s since 1970) that every kernel's file gets. Numba compiles a file again if its
modification time has changed, and two processes may write the same file."""


@dataclass(frozen=True)
class Kernel:
    """Compiled functions for oscillators with any sum of the damping terms `terms` and one restoring law of `laws`.

    terms, laws: names of the damping terms and restoring laws whose forces are compiled. march: function that
    integrates the equation of motion (`march.march`). sums: function that computes weighted sums of the terms' forces
    over given points (`march.sums`).
    """

    terms: tuple[str, ...]
    laws: tuple[str, ...]
    march: Callable[..., Any]
    sums: Callable[..., Any]


def kernel_of(terms: tuple[str, ...], laws: tuple[str, ...]) -> Kernel:
    """Return the kernel, the compiled equation of motion, for the named damping terms and restoring laws.

    Its functions are compiled at their first call. Raises Refusal if a term or law has no method `kernel`, or if this
    method cannot be compiled: its source cannot be read, it is not a plain function, or it uses global names other than
    `math` and `np`.
    """
    return _kernel_of(terms, laws, tuple(map(TERMS.get, terms)), tuple(map(LAWS.get, laws)))


@lru_cache(maxsize=64)
def _kernel_of(terms: tuple[str, ...], laws: tuple[str, ...], *_registered: object) -> Kernel:
    """Return the kernel, the compiled equation of motion, from a cache, or generate it.

    terms, laws: names of the damping terms and restoring laws. _registered: the objects with these names. They are part
    of the cache key, because another object can be registered under the same name.
    """
    module = _module(source_of(terms, laws))
    return Kernel(terms, laws, module.march, module.sums)


def most_parameters(laws: tuple[str, ...]) -> int:
    """Return the largest number of parameters of any of the named restoring laws."""
    return max(len(LAWS.get(name).parameters) for name in laws)


def source_of(terms: tuple[str, ...], laws: tuple[str, ...]) -> str:
    """Return the Python source of the module of a kernel (compiled equation of motion).

    terms, laws: names of the damping terms and restoring laws whose forces the source contains. Raises Refusal as
    `kernel_of`.
    """
    # Lines of three generated functions: `calls` for `shapes`, `sums` for `damping`, `slopes` for `damping_slopes`; the
    # module `tangents` documents these functions. `at` counts the further parameters of the terms so far.
    parts, calls, sums, slopes, at = [_HEAD], list[str](), list[str](), list[str](), 0
    owners, switches, jumps = list[int](), list[bool](), list[bool]()
    for number, name in enumerate(terms):
        term = TERMS.get(name)
        parts.append(_function(term, DampingTerm, f"_shape_{number}", f"damping term {name!r}"))
        further = [f"q[{at + i}]" for i in range(len(term.further))]
        inside = ", ".join(["x", "v", "rounding" if term.rounded else "epsilon", *further])
        x, v, width, *q = _arguments(parts[-1])
        call = f"_shape_{number}({', '.join(['{}', '{}', width, *['{}'] * len(q)])})"
        steps = ["1e-6 * _sizes[0]", "1e-6 * _sizes[1]", *(f"1e-6 * (abs({name}) + 1e-3)" for name in q)]
        parts.append(_derivatives(parts[-1], f"_slopes_{number}", [x, v, *q], call, steps))
        owners += [number] * len(further)
        switches.append(bool(term.switches))
        jumps.append(bool(term.switches and not term.rounded))
        if number == USUAL_TERMS:
            sums.append(f"if c[{len(terms)}] != 0.0:")
            slopes.append(sums[-1])
        margin, c = "" if number < USUAL_TERMS else "    ", f"c[{number}]"
        sums += [f"{margin}if {c} != 0.0:", f"{margin}    total += {c} * _shape_{number}({inside})"]
        calls.append(f"out[{number}] = _shape_{number}({inside}) if active[{number}] else 0.0")
        by_further = [f"by_{i}" for i in range(len(further))]
        slopes += [
            f"{margin}if active[{number}]:",
            f"{margin}    {', '.join(['f', 'by_x', 'by_v', *by_further])} = _slopes_{number}({inside}, sizes)",
            f"{margin}    out[{2 + number}] = share * f",
            f"{margin}    total, x_slope, v_slope = (total + {c} * f, x_slope + {c} * by_x, v_slope + {c} * by_v)",
            *(
                f"{margin}    out[{2 + len(terms) + at + i}] = share * {c} * {slope}"
                for i, slope in enumerate(by_further)
            ),
        ]
        at += len(further)
    others = " or ".join(f"active[{i}]" for i in range(USUAL_TERMS, len(terms))) or "False"
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
        _njit("to_tuples(coefficients, q, active, law)", f"return {tuples}"),
    ]
    for name in TEMPLATES:
        template = Path(__file__).with_name(f"{name}.py").read_text(encoding="utf-8")
        parts.append(template[template.index(f"# --- {name} ---") : template.index(END)])
    return "\n\n".join(parts).replace("@njit\n", "@inner\n")


def _njit(signature: str, *lines: str) -> str:
    """Return the source of a function that Numba compiles, with this signature and these lines of its body."""
    return "".join([f"@njit\ndef {signature}:\n", *(f"    {line}\n" for line in lines)])


def _derivatives(source: str, name: str, seeds: list[str], call: str, steps: list[str]) -> str:
    """Return the source of a function `name` that computes a force and its derivatives by the seeds.

    seeds: the variables of differentiation. source: source of the force. The arguments of the new function are those of
    the force, then `_sizes`, the typical magnitudes from which the steps of difference quotients follow. Difference
    quotients are used only if the source cannot be differentiated. They need `call`, a call of the force with {} in the
    place of each seed, and `steps`, the text of the step for each seed.
    """
    try:
        return derivative_source(source, name, seeds)
    except NoSlopeError:
        return difference_source(call, [*_arguments(source), "_sizes"], dict(zip(seeds, steps)), name)


def _sources_of_laws(laws: tuple[str, ...]) -> list[str]:
    """Return the sources of the functions of all restoring laws, and of `restoring` and `restoring_slopes`.

    In the compiled kernel, the latter two select one of the laws and call its functions. The last element of their
    argument `p` is the index of the law; the elements before it are the law's parameters.
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
    """Return the sources of two functions that compute a restoring law's force and its derivatives.

    For law number N, `_numbers_of_law_N` returns the force and its derivatives. `_slopes_of_law_N` calls it, and
    returns the force and its derivative by the position x. It also writes the derivatives by the parameters, times the
    factor `share`, into the array `out`. source: source of the law's force. number: N. count: number of the law's
    parameters.
    """
    x, p = _arguments(source)
    name, seeds = f"_numbers_of_law_{number}", [f"{p}[{i}]" for i in range(count)]
    call = f"_law_{number}({{}}, ({'{}, ' * count}0.0))"
    steps = ["1e-6 * _sizes[0]", *(f"1e-6 * (abs({q}) + _sizes[{2 + i}])" for i, q in enumerate(seeds))]
    by_parameters = [f"by_{i}" for i in range(count)]
    return [
        _derivatives(source, name, [x, *seeds], call, steps),
        _njit(
            f"_slopes_of_law_{number}(x, p, sizes, share, out, first)",
            f"{', '.join(['f', 'by_x', *by_parameters])} = {name}(x, p, sizes)",
            *(f"out[first + {i}] = share * {slope}" for i, slope in enumerate(by_parameters)),
            "return f, by_x",
        ),
    ]


def _arguments(source: str) -> list[str]:
    """Return the names of the positional arguments of a function, from its source text."""
    function = ast.parse(source).body[0]
    assert isinstance(function, ast.FunctionDef)
    return [a.arg for a in (*function.args.posonlyargs, *function.args.args)]


@lru_cache(maxsize=256)
def _function(plugin: DampingTerm | RestoringLaw, base: type, name: str, what: str) -> str:
    """Return the source of the `kernel` of a damping term or restoring law as a compiled function called `name`.

    Annotations and defaults are removed, because they may refer to names that the module does not import. `math.tanh`
    is replaced by `_tanh`, which takes a third of the time and has an absolute error of 2e-16. base: base class of the
    plug-in, whose `kernel` is only a placeholder. what: description of the plug-in for error messages. Raises Refusal
    if it has no `kernel` that can be compiled.
    """
    function = plugin.kernel
    if type(plugin).kernel is base.kernel:  # type: ignore[attr-defined]
        raise Refusal(f"the {what} has no `kernel`; define this method to compute trajectories")
    try:
        definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    except (OSError, SyntaxError, TypeError):
        raise Refusal(
            f"the source code of the `kernel` of the {what} cannot be read; define this method with `def` in a .py file"
        ) from None
    if not isinstance(definition, ast.FunctionDef):
        raise Refusal(f"the `kernel` of the {what} must be defined with `def`, not as a lambda")
    foreign = sorted(set(function.__code__.co_names) & set(function.__globals__) - {"math", "np"})
    if foreign:
        raise Refusal(
            f"the `kernel` of the {what} uses {foreign[0]!r}; it may only use its arguments, math and np"
        )
    definition.name, definition.returns = name, None
    definition.decorator_list = [ast.Name("njit", ast.Load())]
    for argument in [*definition.args.posonlyargs, *definition.args.args]:
        argument.annotation = None
    definition.args.defaults = []
    return ast.unparse(ast.fix_missing_locations(definition)).replace("math.tanh(", "_tanh(") + "\n"


@lru_cache(maxsize=64)
def _module(text: str) -> ModuleType:
    """Import the source of a kernel as a module, after writing it to a file if this does not exist yet.

    text: the source. The file's folder is named after a digest of the source. Modules are cached in memory.
    """
    name = f"bayesdamp_kernel_{hashlib.sha256(text.encode()).hexdigest()[:20]}"
    spec = importlib.util.spec_from_file_location(name, _store(name, text))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _store(name: str, text: str) -> Path:
    """Write a kernel's source to a folder of its own, called `name`, in the user's cache; return the path of the file.

    If the cache is not writable, use a temporary folder. If the cache has more than `MAX_STORED` kernels, remove the
    least recently used, except those that may be in use (`IN_USE_SECONDS`).
    """
    home = cache_folder() / "kernels"
    try:
        path = _write(home / name, text)
        folders = sorted(home.glob("bayesdamp_kernel_*"), key=lambda folder: folder.stat().st_mtime)
        for folder in folders[: max(len(folders) - MAX_STORED, 0)]:
            if time.time() - folder.stat().st_mtime > IN_USE_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        path = _write(_temporary() / name, text)
    return path


def _write(folder: Path, text: str) -> Path:
    """Write a kernel's source to `kernel.py` in a folder, if this file is missing; return its path.

    The modification time of the folder is set to now, which records the last use. Raises PermissionError if the folder
    is not writable.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "kernel.py"
    if not path.is_file():
        # Write to another name and rename, because another process may write the same file.
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
    """Return a temporary folder for kernels, which is removed when this process ends."""
    folder = Path(tempfile.mkdtemp(prefix="bayesdamp-kernels-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
