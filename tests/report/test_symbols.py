"""How a parameter is written stands on its term: the report asks it, of a user's own term too."""

from __future__ import annotations

from pathlib import Path

from bayesdamp.formatting import Table, TableLine
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_symbol
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report import words


def test_all_that_ship_say_it():
    for term in map(TERMS.get, TERMS.names()):
        for name in (term.parameter, *(p.name for p in term.inferred)):
            assert parameter_symbol(name) is not None, name
    for law in map(LAWS.get, LAWS.names()):
        assert all(parameter_symbol(name) is not None for name in law.parameters)
    assert words.symbol("mu_c").text == "μc"
    assert words.axis("zeta", "1/s") == r"$\zeta$ / (1/s)"


def test_a_term_without_a_symbol_is_named_by_its_own_parameter_and_words(tmp_path):
    """Negative control: once it is forgotten, nothing is said of it."""
    source = (Path(__file__).parents[1] / "plugins" / "cubic_drag.py").read_text(encoding="utf-8")
    (tmp_path / "own.py").write_text(source.replace("    unit =", '    words = "sticky seal"\n    unit ='))
    use_modules(read_modules([tmp_path / "own.py"]))
    try:
        symbol = words.symbol("drag3")
        assert (symbol.text, symbol.meaning) == ("drag3", "coefficient of sticky seal damping")
        assert words.model("viscous+cubic_drag") == "viscous + sticky seal"
    finally:
        use_modules(())
    assert words.symbol("drag3").meaning == "parameter"


def test_indices_are_set_and_marks_of_html_stay_text():
    """In every cell of a table; a record's name may be any."""
    table = Table(["<i>θs"], [TableLine(["<b>μc"])], caption="<u>F_damp", notes=["<s>"])
    shown = table.__html__()
    for text in ("&lt;i&gt;θ<sub>s</sub>", "&lt;b&gt;μ<sub>c</sub>", "&lt;u&gt;F<sub>damp</sub>"):
        assert text in shown
    assert not [mark for mark in ("<i>", "<b>", "<u>", "<s>") if mark in shown]
