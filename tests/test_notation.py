"""The symbol table is complete and free of contradictions."""

import pytest

from flexlab.notation import SYMBOLS, lookup, markdown_table

PAPER = (
    "x x_d e s r Λ K ε b̂ k_i A B M_q K_F h g w̄ M̄_i C̄_i Ḡ_i 𝒥_i J_i u_i τ_i f f_i F_i q q̇ L ρ EI m I θ θ_i p Ψ w N ẋ ẍ"
)


@pytest.mark.parametrize("symbol", PAPER.split())
def test_every_symbol_of_the_paper_is_there(symbol: str):
    row = lookup(symbol)
    assert row.symbol == symbol
    assert row.equation


@pytest.mark.parametrize("column", ["symbol", "word"])
def test_no_name_means_two_things(column: str):
    names = [getattr(row, column) for row in SYMBOLS]
    assert sorted(names) == sorted(set(names))


def test_every_row_is_whole():
    for row in SYMBOLS:
        assert row.symbol
        assert row.code
        assert row.word
        assert row.unit
        assert row.shape.startswith("("), row


def test_code_names_of_one_room_differ():
    # `w` is a turning rate in physics and a deflection on paper; no other name serves twice.
    names = [row.code for row in SYMBOLS if row.code != "w"]
    assert sorted(names) == sorted(set(names))


def test_lookup_by_code_and_word():
    assert lookup("Lambda") is lookup("Λ") is lookup("sliding slope")
    with pytest.raises(KeyError, match="nonsense"):
        lookup("nonsense")


def test_markdown_has_a_line_for_each_symbol():
    assert len(markdown_table().splitlines()) == 2 + len(SYMBOLS)
