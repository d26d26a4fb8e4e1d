"""The whole pipeline, the only part that knows all of it: a study as a graph of independent, named cells."""

from bayesdamp.pipeline.jobs import Depth, cells
from bayesdamp.pipeline.run import run_study

__all__ = ["Depth", "cells", "run_study"]
