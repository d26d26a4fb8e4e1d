"""The pipeline of a study: a graph of independent, named cells, and the one room that knows all the others."""

from bayesdamp.pipeline.jobs import Depth, cells
from bayesdamp.pipeline.run import run_study

__all__ = ["Depth", "cells", "run_study"]
