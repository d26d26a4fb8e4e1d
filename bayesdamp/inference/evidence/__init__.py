"""Methods that compute a model's evidence: one class in one module each, found by name."""

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.plugins import Registry

EVIDENCES: Registry[EvidenceMethod] = Registry("bayesdamp.inference.evidence", "evidence method")

__all__ = ["EVIDENCES", "Draws", "EvidenceMethod"]
