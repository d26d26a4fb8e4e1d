"""Forms of damping beside the terms: compiled kernels only, weighed as rivals of what is named, found by name."""

from __future__ import annotations

from bayesdamp.physics.damping import TERMS, DampingTerm
from bayesdamp.physics.forms._form import Form
from bayesdamp.plugins import Registry

FORMS: Registry[Form] = Registry("bayesdamp.physics.forms", "form of damping")

__all__ = ["FORMS", "Form", "acting"]


def acting(name: str) -> DampingTerm | Form:
    """The damping term, or else the form, of a name. Raises InputError where there is neither."""
    return FORMS.get(name) if name in FORMS.names() else TERMS.get(name)
