"""Elementary functions against mpmath over their whole range; kernels and plain Python give the same bits."""

import math
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from flexlab.compiled import compiled
from flexlab.numerics.elementary import atan2, cos, each, exp, log, sin, sin_cos

COUNT = 3000
ODD = (0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan, 5e-324, -5e-324, 1e308, -1e308)


def off(value: float, exact: mpmath.mpf) -> float:
    """Distance of a value from the exact one, in units in the last place of the exact one."""
    return float(abs(mpmath.mpf(float(value)) - exact) / mpmath.mpf(math.ulp(float(exact))))


def worst(values: np.ndarray, exact: Callable[..., mpmath.mpf], *arguments: np.ndarray) -> float:
    with mpmath.workprec(1300):
        given = zip(*(map(mpmath.mpf, row.tolist()) for row in arguments), strict=True)
        return np.max([off(value, exact(*each)) for value, each in zip(values, given, strict=True)])  # NaN if one is.


@pytest.fixture
def angles() -> np.ndarray:
    """Small, usual and large angles, the largest ones, and those closest to multiples of a right angle."""
    random = np.random.default_rng(1)
    turns = np.concatenate(
        [np.arange(-COUNT, COUNT), random.integers(1, 2**20, COUNT), random.integers(1, 2**50, COUNT)]
    )
    with mpmath.workprec(300):
        right = [float(int(k) * mpmath.pi / 2) for k in turns]
    usual = random.uniform(-20, 20, COUNT)
    every = random.choice([-1, 1], COUNT) * 10.0 ** random.uniform(-308, 308.2, COUNT)
    closest = math.ldexp(6381956970095103, 797)  # the double closest to a multiple of π/2
    return np.array([*right, *usual, *every, closest, 2.0**20, np.nextafter(2.0**20, math.inf)])


def test_sine_and_cosine_are_within_three_quarters_of_a_unit_in_the_last_place(angles: np.ndarray):
    pairs = np.array([sin_cos(angle) for angle in angles.tolist()])
    assert worst(pairs[:, 0], mpmath.sin, angles) < 0.75
    assert worst(pairs[:, 1], mpmath.cos, angles) < 0.75
    assert np.array_equal(each(sin, angles), pairs[:, 0])
    assert np.array_equal(each(cos, angles), pairs[:, 1])


def test_atan2_is_within_0_85_units_in_the_last_place():
    random = np.random.default_rng(2)
    near = random.normal(size=(2, COUNT))
    far = random.normal(size=(2, COUNT)) * 10.0 ** random.uniform(-307, 307, (2, COUNT))
    around = np.array([(math.sin(a), math.cos(a)) for a in random.uniform(-4, 4, COUNT)]).T
    y, x = np.concatenate([near, far, around], axis=1)
    assert (
        worst(np.array([atan2(*point) for point in zip(y.tolist(), x.tolist(), strict=True)]), mpmath.atan2, y, x)
        < 0.85
    )


@pytest.mark.parametrize("y", ODD)
@pytest.mark.parametrize("x", ODD)
def test_atan2_of_special_values_is_that_of_the_standard_library(y: float, x: float):
    found, known = atan2(y, x), math.atan2(y, x)
    assert math.isclose(found, known, rel_tol=1e-15) or (math.isnan(found) and math.isnan(known))
    assert math.copysign(1, found) == math.copysign(1, known) or math.isnan(known)


def test_exp_and_log_are_within_a_unit_in_the_last_place():
    random = np.random.default_rng(3)
    powers = np.concatenate([random.uniform(-745.1, 709.78, COUNT), random.uniform(-1, 1, COUNT), [0.0, -0.0, 1e-300]])
    assert worst(each(exp, powers), mpmath.exp, powers) <= 1
    numbers = np.concatenate([10.0 ** random.uniform(-323, 308, COUNT), random.uniform(0.5, 2, COUNT)])
    assert worst(each(log, numbers), mpmath.log, numbers) <= 1


def test_arguments_without_a_finite_result_give_zero_infinity_or_nan():
    assert np.array_equal([exp(math.inf), exp(-math.inf), exp(709.79), exp(-746.0)], [math.inf, 0.0, math.inf, 0.0])
    assert math.isnan(exp(math.nan))
    assert np.array_equal([log(math.inf), log(0.0), log(-0.0), log(1.0)], [math.inf, -math.inf, -math.inf, 0.0])
    assert math.isnan(log(-1.0))
    assert math.isnan(log(math.nan))
    for angle in (math.inf, -math.inf, math.nan):
        assert np.isnan(sin_cos(angle)).all()
    assert math.copysign(1, sin(-0.0)) == -1


def test_kernels_and_plain_python_give_the_same_bits(angles: np.ndarray):
    @compiled
    def in_a_kernel(x, y, found):
        for k in range(len(x)):
            found[k, 0], found[k, 1] = sin_cos(x[k])
            found[k, 2], found[k, 3], found[k, 4] = atan2(x[k], y[k]), exp(x[k]), log(y[k])

    x = np.array([*angles, *ODD])
    y, found = np.random.default_rng(4).permutation(x), np.empty((len(x), 5))
    in_a_kernel(x, y, found)
    plain = [(*sin_cos(a), atan2(a, b), exp(a), log(b)) for a, b in zip(x.tolist(), y.tolist(), strict=True)]
    assert np.array_equal(found, plain, equal_nan=True)
