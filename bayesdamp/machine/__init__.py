"""Resources of the computer that a run uses: its cache folder, its signals, processes and threads."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ENDS = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name))
"""Signals that end a run, where the system has them."""


def cache_folder() -> Path:
    """Return the folder for what is computed once for a machine; it may not exist yet.

    It is `BAYESDAMP_CACHE`, or the system's folder for caches of programs.
    """
    from platformdirs import user_cache_dir

    return Path(os.environ.get("BAYESDAMP_CACHE") or user_cache_dir("bayesdamp"))


@contextmanager
def kill_as_interrupt() -> Iterator[None]:
    """Treat a signal that ends a run, or the closing of its terminal, like an interrupt from the keyboard.

    A signal that is already handled or ignored, as under `nohup`, stays so.
    """

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    defaults = [end for end in ENDS if signal.getsignal(end) is signal.SIG_DFL]
    for end in defaults:
        signal.signal(end, interrupt)
    try:
        yield
    finally:
        for end in defaults:
            signal.signal(end, signal.SIG_DFL)
