"""JAX, loaded when it is first used: what a command says at first, and the answer by compiled kernels, need none of it.

`jax` and `jnp` stand for the modules; decorators of JAX that a module needs at its own import wait until then too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from functools import cached_property, update_wrapper
from importlib import import_module
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import jax as jax
    import jax.numpy as jnp
else:

    class _Later:
        """A module that is loaded when something of it is asked for."""

        def __init__(self, name: str) -> None:
            self._name = name

        def __getattr__(self, name: str) -> Any:
            if name.startswith("__"):
                raise AttributeError(name)  # what looks into every module's names asks for nothing
            found = getattr(import_module(self._name), name)
            _register()
            self.__dict__[name] = found
            return found

    jax, jnp = _Later("jax"), _Later("jax.numpy")

T = TypeVar("T")
_WAITING: list[Callable[[], object]] = []


def loaded() -> bool:
    """Whether JAX has been loaded."""
    return "jax" in sys.modules


def traced(value: object) -> bool:
    """Whether a value is an array of JAX, a traced one among them; loads nothing."""
    return loaded() and isinstance(value, jax.Array)


def _register() -> None:
    while _WAITING:
        _WAITING.pop()()


def tree(data: Sequence[str], meta: Sequence[str] = ()) -> Callable[[type[T]], type[T]]:
    """Make a dataclass a tree of arrays for JAX. data: its fields of arrays or trees; meta: those that programs are
    compiled for."""

    def decorate(kind: type[T]) -> type[T]:
        def register() -> object:
            import jax

            return jax.tree_util.register_dataclass(kind, list(data), list(meta))

        if loaded():
            register()
        else:
            _WAITING.append(register)
        return kind

    return decorate


class custom_jvp:  # noqa: N801 - JAX's name
    """`jax.custom_jvp` of a function, made when it is first called."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function, self._rule = function, None
        update_wrapper(self, function)

    def defjvp(self, rule: Callable[..., Any]) -> Callable[..., Any]:
        """State the rule: of (primals, tangents), (value, derivative)."""
        self._rule = rule
        return rule

    @cached_property
    def _made(self) -> Callable[..., Any]:
        made = jax.custom_jvp(self._function)
        assert self._rule is not None
        made.defjvp(self._rule)
        return made

    def __call__(self, *args: Any) -> Any:
        """What the function gives."""
        return self._made(*args)


def jit(**options: Any) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """`jax.jit` with these options, made when the function is first called."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        made: list[Callable[..., Any]] = []

        def call(*args: Any, **named: Any) -> Any:
            if not made:
                made.append(jax.jit(function, **options))
            return made[0](*args, **named)

        return update_wrapper(call, function)

    return decorate
