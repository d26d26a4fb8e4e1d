"""The site: `make docs` builds it from these pages, warnings as errors."""

import os
import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE)]
os.environ.setdefault("MPLBACKEND", "agg")

import generated  # noqa: E402
import mathml  # noqa: E402
import pictures  # noqa: E402

from bayesdamp import __version__  # noqa: E402

project = "bayesdamp"
author = "the authors of bayesdamp"
release = version = __version__
html_title = f"bayesdamp {__version__}"

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
napoleon_use_ivar = True
root_doc = "index"
exclude_patterns = ["_build", "_generated"]
myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3
html_theme = "furo"
html_theme_options = {"source_directory": "docs/"}
html_show_sourcelink = False
html_show_copyright = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
python_maximum_signature_line_length = 90

nb_execution_mode = "cache"
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "signature"
autodoc_type_aliases = {"ArrayLike": "numpy.typing.ArrayLike"}
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}


def _as_restructured(app, what, name, obj, options, lines):
    """Docstrings here are plain sentences: marks that reStructuredText would read are escaped, names in backticks are
    code, and examples stay as they are."""
    text = "\n".join(lines)
    blocks = re.split(r"(\n*^>>> .*?(?:\n\n|\Z))", text, flags=re.MULTILINE | re.DOTALL)
    made = []
    for block in blocks:
        if block.lstrip().startswith(">>>"):
            made.append(f"\n\n{block.strip()}\n\n")
            continue
        parts = re.split(r"(`[^`]+`)", block)
        for i, part in enumerate(parts):
            parts[i] = f"``{part[1:-1]}``" if i % 2 else re.sub(r"([\\*|_])", r"\\\1", part)
        made.append("".join(parts))
    lines[:] = "".join(made).split("\n")


def setup(app):
    generated.write(HERE.parent)
    pictures.write(HERE.parent)
    mathml.register(app)
    # Before napoleon, which turns NumPy sections into field lists.
    app.connect("autodoc-process-docstring", _as_restructured, priority=400)
