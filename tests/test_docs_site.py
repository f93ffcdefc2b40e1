"""What the site is built with: formulas and docstrings. Needs the extra docs."""

from __future__ import annotations

import pytest

pytest.importorskip("latex2mathml", reason="not installed: pip install 'fmi-workbench[docs]'")
pytest.importorskip("griffe", reason="not installed: pip install 'fmi-workbench[docs]'")

from docs.tools.docstrings import as_markdown
from docs.tools.mathematics import with_mathml


def test_formulas_become_mathml() -> None:
    page = r'<p>a <span class="arithmatex">\(\dot x &lt; 1\)</span> <div class="arithmatex">\[\frac{a}{b}\]</div></p>'
    found = with_mathml(page)
    assert found.count("<math") == 2
    assert "arithmatex" not in found
    assert 'display="block"' in found
    assert '<mover accent="true">' in found
    assert "&lt;" in found or "&#x0003C;" in found


def test_an_unknown_formula_is_refused() -> None:
    with pytest.raises(ValueError, match="nosuchthing"):
        with_mathml(r'<span class="arithmatex">\(\nosuchthing{a}\)</span>')


def test_docstrings_keep_indices_and_lists() -> None:
    assert as_markdown("shape [amplitude][frequency]") == "shape [amplitude]\\[frequency]"
    assert as_markdown("Two:\n  - a\n  - b\n") == "Two:\n\n  - a\n  - b\n"
    assert as_markdown("Two:\n\n  1. a\n  2. b") == "Two:\n\n  1. a\n  2. b"
