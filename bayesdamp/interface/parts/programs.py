"""Compiled programs are kept between processes, as studies keep them."""

from __future__ import annotations

from functools import cache

import jax

from bayesdamp.pipeline.workers import cache_compilations


@cache
def keep_programs() -> None:
    """Once in a process, and where nobody has chosen a place for JAX's compilations: compiling is most of what a fit
    costs, and the next process need not do it again."""
    if jax.config.jax_compilation_cache_dir is None:  # type: ignore[attr-defined]
        cache_compilations()
