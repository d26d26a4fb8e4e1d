"""Where what is computed once for a machine is kept."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder() -> Path:
    """The folder, which may not exist yet: `BAYESDAMP_CACHE`, or the system's for programs."""
    from platformdirs import user_cache_dir

    return Path(os.environ.get("BAYESDAMP_CACHE") or user_cache_dir("bayesdamp"))
