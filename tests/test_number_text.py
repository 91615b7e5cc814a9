"""Numbers as people read them, and a scenario's fields in words."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexlab.presets import load_preset
from flexlab.recording.store.run_index import duration_text, size_text
from flexlab.scenario.field_text import differences, field_title, told, value_text
from flexlab.text import (
    counted,
    difference_text,
    fixed_text,
    in_mathtext,
    number_text,
    range_text,
    result_text,
    visible,
    with_indices,
    with_subscripts,
)


def test_limits_are_rounded_inwards() -> None:
    cases = {
        (0.0, 1.2347): "0 to 1.234",
        (-1.2347, 1.2341): "−1.234 to 1.234",
        (1.2341, 2147483647): "1.235 to 2.147 · 10⁹",
        (1.23456, 1.23457): "1.23456 to 1.23457",
        (0.001, 1e9): "0.001 to 10⁹",
        (0.1, 0.3): "0.1 to 0.3",
    }
    for limits, text in cases.items():
        assert range_text(*limits) == text


def test_numbers_have_no_letters_and_a_real_minus_sign() -> None:
    cases = {1000.0: "1000", -0.5: "−0.5", 1e9: "10⁹", -2.5e-9: "−2.5 · 10⁻⁹", 31.622: "31.62", -0.0: "0"}
    for value, text in cases.items():
        assert number_text(value) == text
    assert number_text(float("nan")) == number_text(float("inf")) == "–"
    assert number_text(2.0, signed=True) == "+2"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Frequency f_d (Hz)", "Frequency f<sub>d</sub> (Hz)"),
        ("|w|/|w_qs| − 1 ≈ r², r = f_path/f_1", "|w|/|w<sub>qs</sub>| − 1 ≈ r², r = f<sub>path</sub>/f<sub>1</sub>"),
        ("√(e_x² + F_1x²)", "√(e<sub>x</sub>² + F<sub>1x</sub>²)"),
        ("M̄_i and t_μ", "M̄<sub>i</sub> and t<sub>μ</sub>"),
        ("my_law.py, a_b.csv, x_longer, payload.bending_stiffness", None),
    ],
)
def test_an_index_becomes_a_subscript_and_a_name_in_code_stays(text: str, shown: str | None) -> None:
    assert with_subscripts(text) == (shown or text)
    assert (in_mathtext(text) == text) == (shown is None)


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("Adaptation (k0, k1, k2)", "Adaptation (k₀, k₁, k₂)"),
        ("k1² > 4 b̂0 (k2 + δ)", "k₁² > 4 b̂₀ (k₂ + δ)"),
        ("rk4, EI1, k_1, 1e3, t = 3 s, k12", "rk4, EI1, k_1, 1e3, t = 3 s, k12"),
    ],
)
def test_a_numbered_symbol_has_an_index(text: str, shown: str) -> None:
    assert with_indices(text) == shown


def test_a_dollar_sign_begins_no_formula_in_a_figure() -> None:
    assert in_mathtext("costs_i in $, not $\\frac{") == r"costs_i in \$, not \$\frac{"


def test_a_zero_has_no_sign_and_a_rounding_error_is_no_difference() -> None:
    assert fixed_text(-1e-9, 3) == fixed_text(1e-9, 3, signed=True) == "0.000"
    assert fixed_text(-0.13, 3, signed=True) == "−0.130"
    assert difference_text(1.0, 1.0 - 9.44e-16) == "0"
    assert difference_text(2.0, 2.5) == "+0.5"
    assert difference_text(2.0, float("nan")) == "–"
    assert result_text(2.019e-17, 1e3) == "0", "a tracking error in mm"
    assert result_text(2.019e-6, 1e3) == "2.019 · 10⁻⁶"
    assert difference_text(2.019e-17, 5e-18, scale=1e3) == "0"


def test_sizes_and_durations_are_rounded_as_people_write_them() -> None:
    sizes = {
        0: "0 B",
        999: "999 B",
        1500: "1.5 kB",
        999_700: "1 MB",
        2.5e6: "2.5 MB",
        9.996e11: "1 TB",
        2e15: "2000 TB",
    }
    assert {size: size_text(size) for size in sizes} == sizes
    assert [duration_text(span) for span in (None, 1e-5, 119.5, 179.7)] == ["–", "10⁻⁵ s", "119.5 s", "3 min 00 s"]


def test_a_text_is_cut_to_the_length_that_is_allowed() -> None:
    assert (visible("abcd", 4), visible("abcde", 4)) == ("abcd", "abc…")


@given(st.floats())
def test_no_number_is_written_with_an_e_as_nan_or_inf_or_with_a_hyphen(value: float) -> None:
    assert not re.search(r"e[+-]|nan|inf|-", number_text(value) + fixed_text(value, 3))


@given(st.floats(min_value=1e-4, max_value=9e6))
def test_a_number_that_is_written_reads_back_to_four_digits(value: float) -> None:
    assert float(number_text(value)) == pytest.approx(value, rel=5.1e-4)


def test_fields_and_values_are_named_in_words() -> None:
    paper = load_preset("paper")
    other = paper.replace({"controller.kind": "pd", "payload.bending_stiffness": 50.0})
    news = {
        field_title(path, other, paper): (value_text(a), value_text(b))
        for path, a, b in told(differences(paper, other))
    }
    assert news == {
        "Control law": ("adaptive-sliding-mode", "pd"),
        "Bending stiffness EI (N·m²)": ("100", "50"),
    }
    assert field_title("payload.damping.ratio", paper) == "Damping ratio ζ", "without the unit 1"
    assert field_title("controller.integral_gain", paper).startswith("Switching gain"), "of a law that no run here has"
    assert value_text({"linear_density_factor": 1.0}) == "linear density factor 1"
    assert value_text(None) == "–"
    one, other = value_text("a = 1\nb = 2\n"), value_text("a = 1\nb = 3\n")
    assert one != other
    assert all(re.fullmatch(r"2 lines of text \([0-9a-f]{6}\)", text) for text in (one, other))


def test_counts_have_the_noun_in_the_right_number():
    assert [counted(k, "sample") for k in (0, 1, 2)] == ["0 samples", "1 sample", "2 samples"]
