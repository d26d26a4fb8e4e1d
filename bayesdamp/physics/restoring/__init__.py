"""Register restoring laws: one class in one module each, found by name."""

from bayesdamp.physics.restoring._law import LinearForm, RestoringLaw
from bayesdamp.plugins import Registry

LAWS: Registry[RestoringLaw] = Registry("bayesdamp.physics.restoring", "restoring law")

__all__ = ["LAWS", "LinearForm", "RestoringLaw"]
