"""The report of a run's folder: draw and describe what the store contains, without computing any statistics."""

from bayesdamp.report.render import render

__all__ = ["render"]
