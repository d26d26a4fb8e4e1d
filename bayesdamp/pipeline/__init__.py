"""The whole pipeline, the only part that knows all of it: a study as a graph of independent, named cells."""

from bayesdamp.pipeline.run import Cell, cells, run_study

__all__ = ["Cell", "cells", "run_study"]
