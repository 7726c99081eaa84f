"""How Sphinx makes the site: `make docs` (scripts/build_site.py writes the pages of the reference and runs it)."""

import re
from importlib.metadata import version as installed_version
from typing import Any

project = "poseloom"
author = "the poseloom authors"
version = release = installed_version("poseloom")

extensions = ["sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_parser"]
html_theme = "furo"
html_title = f"poseloom {version}"
html_show_sourcelink = False
html_copy_source = False

myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4  # the anchors that code forges make, too

default_role = "py:obj"  # docstrings write `name`, as Markdown does: a link where there is such a name
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True  # a dataclass's fields are described once, in its docstring
napoleon_attr_annotations = False  # shapes are no reStructuredText

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
autodoc_default_options = {"exclude-members": "__init__, __new__, __weakref__"}
maximum_signature_line_length = 100
python_use_unqualified_type_names = True


def setup(app: Any) -> None:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", _as_markdown, priority=400)  # before napoleon


def _as_markdown(_app: Any, _what: str, _name: str, _value: object, _options: object, lines: list[str]) -> None:
    """Lets stars and bars stand for themselves, as they do between a docstring's words."""
    for index, line in enumerate(lines):
        parts = line.split("`")
        parts[::2] = [re.sub(r"([*|])", r"\\\1", part) for part in parts[::2]]
        lines[index] = "`".join(parts)
