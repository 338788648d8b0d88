"""How `make docs` makes pages of docs/: Sphinx, MyST, and formulas as MathML, which browsers draw without a script."""

import re
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

import stickslip

ZIAMATH = find_spec("ziamath")
assert ZIAMATH is not None
assert ZIAMATH.origin is not None
BARS, TIGHT = re.compile("<mo[^>]*>([|‖])</mo>"), r'<mo stretchy="false" lspace="0" rspace="0">\1</mo>'  # of |x|
FONT = Path(ZIAMATH.origin).parent / "fonts" / "STIXTwoMath-Regular.ttf"

project = "stickslip"
author = "the stickslip authors"
copyright = author
version = release = stickslip.__version__
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["conf.py"]
html_theme = "furo"
html_static_path = ["style.css", str(FONT)]
html_css_files = ["style.css"]
html_title = f"stickslip {version}"
html_copy_source = False
smartquotes = False  # keys and values are quoted as they are typed
html_math_renderer = "mathml"
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
nb_execution_mode = "force"  # the notebook is stored without what it shows
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = -1  # none: machines differ
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the signatures name shapes by aliases of arrays; docstrings say what they hold
autodoc_preserve_defaults = True
pygments_style = "friendly"


def mathml(self: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML."""
    block = isinstance(node, nodes.math_block)
    formula = BARS.sub(TIGHT, "".join(tex2mathml(node.astext(), as_block=block)))
    self.body.append(f'<div class="math">{formula}</div>' if block else formula)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register what this file adds."""
    app.add_html_math_renderer("mathml", (mathml, None), (mathml, None))
