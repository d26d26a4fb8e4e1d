"""One reader a file format, found by name."""

from bayesdamp.plugins import Registry
from bayesdamp.signals.files.contents import Reader

READERS: Registry[Reader] = Registry("bayesdamp.signals.readers", "reader")
