"""Model evidence: its methods, found by name, and how far to trust their results."""

from bayesdamp.inference.evidence.method import Draws, EvidenceMethod
from bayesdamp.plugins import Registry

EVIDENCES: Registry[EvidenceMethod] = Registry(
    "bayesdamp.inference.evidence.methods", "evidence method", home="bayesdamp.inference.evidence"
)

__all__ = ["EVIDENCES", "Draws", "EvidenceMethod"]
