"""Templates escape everything that is inserted, and fail on a missing value."""

import re

import pytest
from jinja2 import UndefinedError
from markupsafe import Markup

from flexlab.server.pages import TEMPLATES, button, render
from flexlab.text import with_units

HOSTILE = "<script>alert('x')</script>\"&\ud800"


def test_inserted_texts_are_escaped_and_can_be_encoded():
    text = render("message.html", title=HOSTILE, sentence=HOSTILE, more="<b>", here="", kind=HOSTILE, scripts=())
    assert "<script>alert" not in text
    assert text.count("&lt;script&gt;alert(&#x27;x&#x27;)&lt;/script&gt;&quot;&amp;�") == 4
    assert "&lt;b&gt;" in text, "only what a template made is HTML"
    assert text.encode()


def test_a_button_escapes_its_address_and_its_words():
    assert button('"><script>', "<i>").count("<") == 2
    assert isinstance(button("/", "x"), Markup)


def test_no_line_breaks_between_a_number_and_its_unit():
    said = (
        "2 arms ring at 45.5 Hz by 0.44 s, to 1 % of 3 micrometres, at 1.78 m/s, 50 1/s, 2 mJ and 10¹² N·m², "
        "at 2 MB/min or 1 GB in 3 places, from t = 1 s on, with |w| ≈ −2 mm drawn × 50, if a = b"
    )
    assert with_units(said).split(" ") == (
        "2 arms ring at 45.5\xa0Hz by 0.44\xa0s, to 1\xa0% of 3\xa0micrometres, "
        "at 1.78\xa0m/s, 50\xa01/s, 2\xa0mJ and 10¹²\xa0N·m², at 2\xa0MB/min or 1\xa0GB in 3 places, "
        "from t\xa0=\xa01\xa0s on, with |w|\xa0≈\xa0−2\xa0mm drawn\xa0×\xa050, if a = b"
    ).split(" ")


def test_a_missing_value_is_an_error_and_not_left_empty():
    with pytest.raises(UndefinedError, match="sentence"):
        render("message.html", title="x", here="", kind="", scripts=())


@pytest.mark.parametrize("name", sorted(path.name for path in TEMPLATES.iterdir()))
def test_no_template_turns_off_escaping_or_has_an_inline_script(name: str):
    text = (TEMPLATES / name).read_text(encoding="utf-8")
    assert "safe" not in text
    assert "autoescape" not in text
    assert not re.search(r"<script(?![^>]* src=)|\son\w+=|javascript:", text)
