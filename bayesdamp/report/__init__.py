"""The report of a run's folder: it draws and words what the store holds, and computes no statistics."""

from bayesdamp.report.render import render

__all__ = ["render"]
