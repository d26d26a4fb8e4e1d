"""One reader a file format, found by name."""

from bayesdamp.plugins import Registry
from bayesdamp.records.files.contents import Reader

READERS: Registry[Reader] = Registry("bayesdamp.records.readers", "reader")
