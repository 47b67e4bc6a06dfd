"""Formulas of pages: drawn by browsers, code left alone."""

import pytest

from tools.mathml import with_mathml

pytest.importorskip("latex2mathml")


def test_formulas_in_a_line_and_of_their_own():
    page = with_mathml("with $\\eta = 0.6$ m/s\n\n$$F = -\\nabla U \\qquad (1)$$\n")
    assert page.count("<math") == 2 and 'display="inline"' in page and 'display="block"' in page
    assert with_mathml("$x$ is a length").startswith("<span><math")
    assert "$" not in page and "\\" not in page and "<mn>0.6</mn>" in page


@pytest.mark.parametrize(
    "text",
    [
        "`$HOTICE_CACHE` and `$HOME`",
        "```sh\necho $A $B\n```\n",
        "an escaped \\$x$ sign",
        "| a$ | $ b |",
    ],
)
def test_what_is_no_formula_stays(text):
    assert with_mathml(text) == text


@pytest.mark.parametrize("formula", ["\\left( x", "x^", "\\unknown{x}"])
def test_a_broken_formula_is_told(formula):
    with pytest.raises(ValueError, match="no formula: "):
        with_mathml(f"so ${formula}$ it is")


def test_all_pages_can_be_drawn():
    from tools.site import ROOT

    for page in [*(ROOT / "docs").glob("*.md"), *(ROOT / "hotice" / "policies").glob("*.md")]:
        with_mathml(page.read_text(encoding="utf-8"))
    assert with_mathml((ROOT / "docs" / "notation.md").read_text(encoding="utf-8")).count("<math") > 10
