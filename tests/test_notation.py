"""The symbol table is complete and free of contradictions."""

import ast
import re
from pathlib import Path

import pytest

from flexlab.notation import NOT_FORMED, SYMBOLS, lookup

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


def test_every_row_has_all_its_entries():
    for row in SYMBOLS:
        assert row.symbol
        assert row.code
        assert row.word
        assert row.unit
        assert row.shape.startswith("("), row


def test_no_code_name_stands_for_two_symbols():
    # `w` is a turning rate in the code and a deflection in the formulas; no other name has two meanings.
    names = [row.code for row in SYMBOLS if row.code not in ("w", NOT_FORMED)]
    assert sorted(names) == sorted(set(names))


def names_in_code(root: Path) -> set[str]:
    """Return all names given in physics, control and the table of signals: functions, arguments, variables, fields."""
    names = set()
    files = [file for room in ("physics", "control") for file in (root / "flexlab" / room).rglob("*.py")]
    for file in (*files, root / "flexlab" / "sim" / "signals.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.arg):
                names.add(node.arg)
            elif isinstance(node, ast.FunctionDef):
                names.add(node.name)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                names.add(node.id)
    return names


def test_every_code_name_is_used_in_the_code(root: Path):
    names = names_in_code(root)
    for row in SYMBOLS:
        assert row.code == NOT_FORMED or row.code.split("[")[0] in names, f"{row.symbol} is called {row.code} nowhere"
    assert [row.symbol for row in SYMBOLS if row.code == NOT_FORMED] == ["p", "φ_i", "J_i", "Ψ"]


def equations_cited(root: Path) -> set[str]:
    """Return the numbers that docstrings of physics and control cite as `Eq. (25)` or in a list, `Eqs. (23), (24) and (25)`."""
    cited = set()
    for file in (file for room in ("physics", "control") for file in (root / "flexlab" / room).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if (
                isinstance(node, ast.Expr)
                and isinstance(node.value, ast.Constant)
                and isinstance(node.value.value, str)
            ):
                for found in re.findall(r"Eqs?\.\s((?:\(\d+\)(?:,\s|\sand\s)?)+)", node.value.value):
                    cited |= set(re.findall(r"\(\d+\)", found))
    return cited


def test_the_docstrings_cite_every_equation_of_the_table(root: Path):
    # The beam's own equation, (18), introduces no symbol.
    numbers = {row.equation for row in SYMBOLS if row.equation.startswith("(")} | {"(18)"}
    assert sorted(numbers - equations_cited(root)) == []


def test_lookup_by_code_and_word():
    assert lookup("Lambda") is lookup("Λ") is lookup("sliding slope")
    with pytest.raises(KeyError, match="nonsense"):
        lookup("nonsense")
