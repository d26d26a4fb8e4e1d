"""Equations as MathML, which browsers draw themselves: a page asks nothing of the network."""

from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.util.docutils import nodes


def _inline(translator, node):
    translator.body.append(tex2mathml(node.astext(), as_block=False))
    raise nodes.SkipNode


def _block(translator, node):
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def register(app):
    """As the renderer that `html_math_renderer = "mathml"` asks for."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
