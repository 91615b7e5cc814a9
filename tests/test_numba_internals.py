"""The internals of numba that flexlab uses still exist, and are left as they were."""

import gc
import importlib
import os
import subprocess
import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core.cpu import CPUContext
from numba.core.types.functions import BaseFunction

from flexlab.compiled import PLAIN_PYTHON, compiled, entry_point, inlined
from flexlab.numba_internals import BitcodeLibrary, QuickCache, QuickCompiler, fingerprint

pytestmark = pytest.mark.skipif(PLAIN_PYTHON, reason="nothing is compiled")


def test_a_built_in_function_is_typed_once_for_the_same_arguments(monkeypatch):
    asked = []
    find = BaseFunction.get_call_type

    def counted(self, context, arguments, keywords):
        asked.append((self, tuple(arguments)))
        return find(self, context, arguments, keywords)

    monkeypatch.setattr(BaseFunction, "get_call_type", counted)

    @numba.njit(pipeline_class=QuickCompiler)
    def total(a, b):
        return a + b + (a + b) + (a + b) * (a + b) + (b + a) * (a + b + a)

    assert total(1.0, 2.0) == 3 + 3 + 9 + 12
    assert len(asked) == len(set(asked)) > 0


def test_a_function_that_belongs_to_no_module_compiles():
    """Libraries make such functions from text; the note on flexlab's own compilation asked for the module's name."""
    made = {"njit": numba.njit}
    exec("@njit\ndef double(x):\n    return 2 * x", made)
    assert made["double"].py_func.__module__ is None
    assert made["double"](2) == 4


def test_numba_is_left_as_it_was_even_by_a_kernel_that_does_not_compile():
    before = BaseFunction.get_call_type

    @numba.njit(pipeline_class=QuickCompiler)
    def wrong(a):
        return a + "text"

    with pytest.raises(numba.TypingError):
        wrong(1.0)
    assert BaseFunction.get_call_type is before
    assert gc.isenabled()


def test_a_branch_for_an_argument_that_is_none_is_not_compiled():
    """`sim.integrators.step` relies on it: only the chosen integrator is compiled."""

    @inlined
    def never(a):
        return a.no_such_thing

    @numba.njit(pipeline_class=QuickCompiler)
    def chosen(array, number):
        result = 0.0
        if array is not None:
            result = never(array)
        if number is not None:
            result = number
        return result

    assert chosen(None, 2.0) == 2.0
    assert not never._dispatcher.overloads  # type: ignore[attr-defined]
    assert np.isfinite(chosen(None, 1.0))


def test_machine_code_is_read_from_disk_without_loading_the_compiler(monkeypatch, tmp_path):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path))

    def length(a, b):
        return np.sqrt(np.sin(a[0]) ** 2 + b**2)

    def kernel():
        made = numba.njit(cache=True, nogil=True, _nrt=False)(length)
        made._cache = QuickCache(length)
        return made

    expected = kernel()(np.ones(2), 2.0)

    def refresh(_):
        raise AssertionError("this loads how numba translates all of numpy")

    with monkeypatch.context() as without:
        without.setattr(CPUContext, "refresh", refresh)
        without.setattr("flexlab.numba_internals.parse_bitcode", refresh)
        again = kernel()
        assert again(np.ones(2), 2.0) == expected
        assert sum(again.stats.cache_hits.values()) == 1

    @numba.njit
    def caller(a, b):
        return 2 * again(a, b)

    assert caller(np.ones(2), 2.0) == 2 * expected


def twice(number):
    return number + number


def test_checkouts_with_the_same_source_share_machine_code(monkeypatch, tmp_path):
    monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / "cache"))

    def kernel(checkout, text):
        folder = tmp_path / checkout
        folder.mkdir()
        (folder / "kernels_of_a_checkout.py").write_text(text)
        with monkeypatch.context() as circumstances:
            circumstances.syspath_prepend(str(folder))
            circumstances.delitem(sys.modules, "kernels_of_a_checkout", raising=False)
            function = importlib.import_module("kernels_of_a_checkout").kernel
            made = numba.njit(cache=True, nogil=True, _nrt=False)(function)
            made._cache = QuickCache(function)
            assert made(3.0) == 6.0
        return sum(made.stats.cache_hits.values())

    text = "def kernel(number):\n    return number + number\n"
    assert kernel("here", text) == 0
    assert kernel("elsewhere", text) == 1
    assert kernel("changed", text + "OTHER = 1\n") == 0


def test_a_kernel_has_one_file_name_that_no_other_kernel_has(monkeypatch, tmp_path):
    """Numba's index is read and written in two steps, between which another process may take the same number."""

    def names(folder, argument):
        monkeypatch.setattr("numba.core.config.CACHE_DIR", str(tmp_path / folder))
        made = numba.njit(cache=True, nogil=True, _nrt=False)(twice)
        made._cache = QuickCache(twice)
        made(argument)
        return {file.name for file in (tmp_path / folder).rglob("*.nb?")}

    whole, real = names("whole", 3), names("real", 3.0)
    assert len(whole) == len(real) == 1
    assert not whole & real
    assert names("again", 4.0) == real


class Pair(NamedTuple):
    numbers: np.ndarray
    count: int


def test_fingerprints_tell_apart_arguments_that_need_their_own_machine_code():
    square = np.ones((2, 2))
    frozen = square.copy()
    frozen.flags.writeable = False
    kinds = [
        (square,), (square.T,), (square[:, :1],), (square[0],), (frozen,), (square > 0,), (1,), (1.0,), (True,), (None,),
        (Pair(square, 1),), (Pair(square.T, 1),), (Pair(square, 1), 1), (),
    ]  # fmt: skip
    assert len({fingerprint(arguments) for arguments in kinds}) == len(kinds)
    assert fingerprint((Pair(square, 1), 2.0)) == fingerprint((Pair(2 * square, 3), 4.0))


def test_an_entry_point_is_made_once_for_arguments_of_the_same_types():
    total = compiled(_total)
    numbers = np.arange(3.0)
    assert entry_point(total, numbers) is entry_point(total, numbers + 1)
    assert entry_point(total, numbers)(numbers + 1) == total(numbers + 1) == 6.0
    assert entry_point(total, np.arange(3))(np.arange(3)) == 3


def _total(numbers):
    result = numbers[0]
    for k in range(1, len(numbers)):
        result += numbers[k]
    return result


def test_only_inlined_kernels_become_part_of_the_kernels_that_call_them():
    total = compiled(_total)

    @inlined
    def next_total(numbers):
        return total(numbers) + 1

    @numba.njit(pipeline_class=QuickCompiler)
    def whole(numbers):
        return next_total(numbers)

    assert whole(np.arange(4.0)) == 7
    (text,) = whole.inspect_llvm().values()
    defined = [line for line in text.splitlines() if line.startswith("define")]
    assert any("_total" in line and "next_total" not in line for line in defined)
    assert not any("next_total" in line for line in defined)
    (alone,) = next_total._dispatcher.overloads.values()  # type: ignore[attr-defined]
    assert isinstance(alone.library, BitcodeLibrary), "it has no machine code of its own"


class _Arrays(NamedTuple):
    numbers: np.ndarray
    count: int
    is_left: bool
    nothing: None


class _Outer(NamedTuple):
    inner: _Arrays
    scale: float


def _sum_of(outer):
    count = outer.inner.count if outer.inner.is_left else 0
    if outer.inner.nothing is not None:
        count += 100
    return outer.scale * outer.inner.numbers.sum() + count


@pytest.mark.parametrize("decorate", [inlined, compiled])
@pytest.mark.parametrize("module", ["flexlab.sim.world", "a_persons_own"])
def test_a_named_tuple_of_flexlab_is_one_argument(monkeypatch, decorate, module):
    """Also in functions that numba compiles as ever; the tuples of others stay as numba has them."""
    arrays, outer_kind = (type(kind.__name__, (kind,), {}) for kind in (_Arrays, _Outer))
    for kind in (arrays, outer_kind):
        monkeypatch.setattr(kind, "__module__", module)
    inner = decorate(_sum_of)

    @numba.njit
    def whole(outer, before):
        return before + inner(outer)

    outer = outer_kind(arrays(np.arange(4.0), 3, True, None), 0.5)
    assert whole(outer, 10.0) == 10 + 0.5 * 6 + 3
    (result,) = whole.overloads.values()
    (line,) = (
        line
        for line in whole.inspect_llvm()[result.signature.args].splitlines()
        if f"@{result.fndesc.mangled_name}(" in line and "define" in line
    )
    assert (line.count("arg.outer") == 1) == (module != "a_persons_own")


UNKNOWN_NUMBA = """
import numpy as np
from flexlab.compiled import QUICK, call_number_kernel, compiled, entry_point, inlined, kernel_address, pluggable
from numba import float64

assert not QUICK
parameters = np.dtype([("slope", "f8")])

@inlined
def twice(a):
    return 2 * a

@pluggable
def line(record, a):
    return record.slope * twice(a)

@compiled
def ask(address, given, a):
    return twice(call_number_kernel(address, given, (a,)))

address = kernel_address(line, parameters, float64, returns=float64)
given = np.array([3.0])
arguments = address, given, 0.5
print(ask(*arguments), entry_point(ask, *arguments)(*arguments))
"""


def test_an_unknown_version_of_numba_compiles_without_its_internals(tmp_path):
    file = tmp_path / "program.py"  # Numba caches only functions from a file.
    file.write_text(UNKNOWN_NUMBA)
    circumstances = os.environ | {"FLEXLAB_PLAIN_NUMBA": "1", "NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, file], env=circumstances, capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == ["6.0", "6.0"]
