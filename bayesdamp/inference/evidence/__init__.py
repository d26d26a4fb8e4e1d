"""Methods that compute the evidence of a model: one class in one module each, looked up by name."""

from bayesdamp.inference.evidence._method import Draws, EvidenceMethod
from bayesdamp.plugins import Registry

EVIDENCES: Registry[EvidenceMethod] = Registry("bayesdamp.inference.evidence", "evidence method")

__all__ = ["EVIDENCES", "Draws", "EvidenceMethod"]
