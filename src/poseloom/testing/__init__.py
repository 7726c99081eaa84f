"""The contracts of methods, sources and motion file formats, as checks for poseloom's own tests and for anybody's.

Each check raises an AssertionError that says what is broken, and needs no test framework.
"""

from poseloom.testing._formats import check_format
from poseloom.testing._methods import check_method
from poseloom.testing._sources import Heard, check_source

__all__ = ["Heard", "check_format", "check_method", "check_source"]
