"""The report writes a parameter with the symbol of its damping term or law, also for a user's own term."""

from bayesdamp.formatting import Table, TableLine
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.symbols import parameter_symbol
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.report import words
from tests.studies import plugin_source


def test_every_parameter_of_a_shipped_term_or_law_has_a_symbol():
    for term in map(TERMS.get, TERMS.names()):
        for name in (term.parameter, *(p.name for p in term.inferred)):
            assert parameter_symbol(name) is not None, name
    for law in map(LAWS.get, LAWS.names()):
        assert all(parameter_symbol(name) is not None for name in law.parameters)
    assert words.symbol("mu_c").text == "μc"
    assert words.axis("zeta", "1/s") == r"$\zeta$ / (1/s)"
    units = {"m/s^2": "m/s²", "1/m**2": "1/m²", "rad^3": "rad³", "1/s2": "1/s²"}
    assert {text: words.unit(text) for text in units} == units


def test_a_user_s_term_without_a_symbol_is_written_with_the_name_of_its_parameter(tmp_path):
    """Control: without the plug-in the parameter has no meaning."""
    source = plugin_source("cubic_drag")
    (tmp_path / "own.py").write_text(source.replace("    unit =", '    words = "sticky seal"\n    unit ='))
    use_modules(read_modules([tmp_path / "own.py"]))
    symbol = words.symbol("drag3")
    assert (symbol.text, symbol.meaning) == ("drag3", "coefficient of sticky seal damping")
    assert words.model("viscous+cubic_drag") == "viscous + sticky seal"
    use_modules(())
    assert words.symbol("drag3").meaning == "parameter"


def test_indices_are_subscripts_and_html_of_the_user_is_escaped():
    """In every part of a table."""
    shown = Table(["<i>θs"], [TableLine(["<b>μc"])], caption="<u>F_damp", notes=["<s>"]).__html__()
    for text in ("&lt;i&gt;θ<sub>s</sub>", "&lt;b&gt;μ<sub>c</sub>", "&lt;u&gt;F<sub>damp</sub>"):
        assert text in shown
    assert not [mark for mark in ("<i>", "<b>", "<u>", "<s>") if mark in shown]
