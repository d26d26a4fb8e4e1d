"""Register the readers, one for each file format."""

from bayesdamp.plugins import Registry
from bayesdamp.records.files.contents import Column, Contents, Reader

READERS: Registry[Reader] = Registry("bayesdamp.records.readers", "reader", home="bayesdamp.records.files")
"""All readers, by name."""

__all__ = ["READERS", "Column", "Contents", "Reader"]
