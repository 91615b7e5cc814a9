"""Sine, cosine, angle, exponential and logarithm with the same bits on every machine, each at most 1 ulp off.

The C library's functions differ between its versions, and between processors with and without fused multiply-add. These use
+ - × ÷ alone, in kernels as in plain Python. The polynomials are those of fdlibm (Sun Microsystems, 1993; `k_sin.c`,
`k_cos.c`, `s_atan.c`, `e_exp.c`, `e_log.c`). √ has the same bits everywhere, and so has hypot written as √(x² + y²).
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexlab.compiled import compiled, inlined

ROUND = 1.5 * 2.0**52
"""Adding it to a number below 2⁵¹ and subtracting it again leaves the nearest whole number."""
SPLIT = 2.0**27 + 1
"""Splits a number into halves of 26 bits (Dekker, Numer. Math. 18 (1971) 224)."""
TURNED = 0.6366197723675814
"""2/π."""
QUARTER = (1.5707963267341256, 6.077094383272197e-11, 6.12323399409214e-17, 1.6446256936324258e-26)
"""π/2 in parts of 33, 21, 32 and 53 bits: products of the first three with whole numbers of 20 bits are exact."""
QUARTER_1, QUARTER_2, QUARTER_3, QUARTER_4 = QUARTER
STRAIGHT_AHEAD = 0.785
"""Angle, rad, a little below π/4, up to which no multiple of π/2 is subtracted."""
NEAR = 2.0**20
"""Largest angle, rad, for which the parts of `QUARTER` suffice."""
DIGIT, MASK = 26, 2**26 - 1
"""Bits of one digit of 2/π, and their mask: products of two digits fit into an integer."""
LEADING = 2 * DIGIT
"""Zero bits before 2/π: numbers above `NEAR` reach no further back."""
_BITS = int(
    "a2f9836e4e441529fc2757d1f534ddc0db6295993c439041fe5163abdebbc561b7246e3a424dd2e006492eea09d1921cfe1deb1cb129a73ee88235"
    "f52ebb4484e99c7026b45f7e413991d639835339f49c845f8bbdf9283b1ff897ffde05980fef2f118b5a0a6d1f6d367ecf27cb09b74f463f669e5f"
    "ea2d7527bac7ebe5f17b3d0739f78a5292ea6bfb5fb11f8d5d0856033046fc7b6babf0cfbc20",
    16,
)
DIGITS = np.array([_BITS >> DIGIT * (49 - k) & MASK for k in range(50)])
"""2/π after `LEADING` zero bits, with enough digits for the largest number."""
ANGLE_HALF, ANGLE_HALF_REST = 0.4636476090008061, 2.2698777452961687e-17
ANGLE_ONE, ANGLE_ONE_REST = 0.7853981633974483, 3.061616997868383e-17
"""atan ½ and atan 1, and their rounding errors."""
RIGHT, RIGHT_REST = 1.5707963267948966, 6.123233995736766e-17
STRAIGHT, STRAIGHT_REST = 3.141592653589793, 1.2246467991473532e-16
"""π/2 and π."""
SMALL, LARGE, RESCALE = 2.0**-900, 2.0**900, 2.0**600
"""Between the first two, nothing in `direction_angle` under- or overflows; the third scales numbers into that range."""
SAME = 1e-8
"""Ratio up to which an angle equals its tangent."""
LN2, LN2_REST = 6.93147180369123816490e-01, 1.90821492927058770002e-10
PER_LN2 = 1.4426950408889634
LARGEST_EXPONENT, SMALLEST_EXPONENT = 709.782712893384, -745.1332191019412
"""Beyond them, exp is infinite or zero."""
ROOT_HALF = 0.7071067811865476
FRACTION, ONE = 2**52 - 1, 1023 << 52
"""Mask of a number's fraction bits; the bits of 1.0."""


@inlined
def sin_cos(x):
    """sin x and cos x, x in rad; NaN for an infinite or NaN x."""
    if abs(x) <= STRAIGHT_AHEAD:
        quadrant, r, rest = 0, x, 0.0
    elif abs(x) <= NEAR:
        turns = (x * TURNED + ROUND) - ROUND
        near = (x - turns * QUARTER_1) - turns * QUARTER_2
        off = turns * QUARTER_3
        r = near - off
        rest = ((near - r) - off) - turns * QUARTER_4
        quadrant = int(turns)
    else:
        quadrant, r, rest = reduced(x)
    z = r * r
    w, v = z * z, z * r
    high = 8.33333333332248946124e-03 + z * (-1.98412698298579493134e-04 + z * 2.75573137070700676789e-06)
    high += z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    sine = r - ((z * (0.5 * rest - v * high) - rest) + v * 1.66666666666666324348e-01)
    high = z * (4.16666666666666019037e-02 + z * (-1.38888888888741095749e-03 + z * 2.48015872894767294178e-05))
    high += w * w * (-2.75573143513906633035e-07 + z * (2.08757232129817482790e-09 - z * 1.13596475577881948265e-11))
    half = 0.5 * z
    most = 1.0 - half
    cosine = most + (((1.0 - most) - half) + (z * high - r * rest))
    if quadrant & 1:
        sine, cosine = cosine, sine
    return (-sine if quadrant & 2 else sine), (-cosine if (quadrant + 1) & 2 else cosine)


@inlined
def sin(x):
    """sin x, x in rad."""
    return sin_cos(x)[0]


@inlined
def cos(x):
    """cos x, x in rad."""
    return sin_cos(x)[1]


@inlined
def _two_over_pi(place):
    """`DIGIT` bits of `DIGITS` from bit number `place` on."""
    k, shift = place // DIGIT, place % DIGIT
    return (DIGITS[k] << shift | DIGITS[k + 1] >> DIGIT - shift) & MASK


@compiled
def reduced(x):
    """Return quadrant q, r and rest with x - q π/2 = r + rest, |r| ≤ π/4, for |x| above `NEAR` (Payne & Hanek, 1983)."""
    if not abs(x) < np.inf:
        return 0, np.nan, np.nan
    bits = int(np.float64(abs(x)).view(np.int64))
    mantissa, place = (bits & FRACTION) | (FRACTION + 1), (bits >> 52) - 1075 + LEADING - 2
    # |x| · 2/π modulo 4, as six digits after the point; the digits before it are whole turns.
    upper, lower = mantissa >> DIGIT, mantissa & MASK
    carry = 0
    first = second = third = 0
    for k in range(5, -1, -1):
        total = upper * _two_over_pi(place + DIGIT * (k + 1)) + lower * _two_over_pi(place + DIGIT * k) + carry
        digit, carry = total & MASK, total >> DIGIT
        weighted = digit << DIGIT if k % 2 == 0 else digit
        if k < 2:
            first += weighted
        elif k < 4:
            second += weighted
        else:
            third += weighted
    quadrant, first = first >> 50, first & 2**50 - 1
    if first >= 2**49:
        quadrant, first = quadrant + 1, first - 2**50
    part, next_part = first * 2.0**-50, second * 2.0**-102
    turn = part + next_part
    turn_rest = ((part - turn) + next_part) + third * 2.0**-154
    product = turn * RIGHT
    rest = product_rest(turn, RIGHT, product) + (turn * RIGHT_REST + turn_rest * RIGHT)
    r = product + rest
    rest = (product - r) + rest
    return (quadrant, r, rest) if x > 0 else (-quadrant, -r, -rest)


@inlined
def product_rest(a, b, product):
    """Return a b - product exactly: the rounding error of the `product` of a and b."""
    wide = SPLIT * a
    a1 = wide - (wide - a)
    wide = SPLIT * b
    b1 = wide - (wide - b)
    a2, b2 = a - a1, b - b1
    return ((a1 * b1 - product) + (a1 * b2 + a2 * b1)) + a2 * b2


@inlined
def atan2(y, x):
    """The angle of (x, y), rad, from -π to π, with the sign of y."""
    if SMALL < max(abs(x), abs(y)) < LARGE:
        return direction_angle(y, x)
    return _extreme_angle(y, x)


@inlined
def direction_angle(y, x):
    """`atan2` of numbers that are neither too small nor too large, such as sine and cosine."""
    across, along = abs(y), abs(x)
    steep, back = across > along, x < 0
    small, big = (along, across) if steep else (across, along)
    # Angle = start + atan t with start + rest known exactly; a smaller t leaves a smaller rounding error.
    start, rest = 0.0, 0.0
    if small <= 0.4375 * big:
        t = small / big
        start = t
        if t > SAME:
            product = t * big
            rest = ((small - product) - product_rest(t, big, product)) / big
    elif small <= 0.6875 * big:
        t = (small - 0.5 * big) / (big + 0.5 * small)
        start, rest = ANGLE_HALF, ANGLE_HALF_REST + t
    else:
        t = (small - big) / (big + small)
        start, rest = ANGLE_ONE, ANGLE_ONE_REST + t
    z = t * t
    w = z * z
    odd = 6.66107313738753120669e-02 + w * (4.97687799461593236017e-02 + w * 1.62858201153657823623e-02)
    odd = 3.33333333333329318027e-01 + w * (1.42857142725034663711e-01 + w * (9.09088713343650656196e-02 + w * odd))
    even = -7.69187620504482999495e-02 + w * (-5.83357013379057348645e-02 - w * 3.65315727442169155270e-02)
    even = w * (-1.99999999998764832476e-01 + w * (-1.11111104054623557880e-01 + w * even))
    rest -= t * (z * odd + even)
    if steep != back:
        start, rest = -start, -rest
    if steep:
        turned, missing = RIGHT, RIGHT_REST
    elif back:
        turned, missing = STRAIGHT, STRAIGHT_REST
    else:
        turned, missing = 0.0, 0.0
    angle = turned + start
    angle += ((turned - angle) + start) + (missing + rest)
    return np.copysign(angle, y)


@compiled
def _extreme_angle(y, x):
    """`atan2` of numbers that are too small or too large, infinite or NaN."""
    if x != x or y != y:
        return np.nan
    if abs(x) == np.inf or abs(y) == np.inf:
        x, y = np.copysign(1.0 if abs(x) == np.inf else 0.0, x), np.copysign(1.0 if abs(y) == np.inf else 0.0, y)
    elif max(abs(x), abs(y)) >= LARGE:
        x, y = x / RESCALE, y / RESCALE
    elif x != 0 or y != 0:
        x, y = x * RESCALE, y * RESCALE
    else:
        x = np.copysign(1.0, x)
    return direction_angle(y, x)


@inlined
def exp(x):
    """eˣ."""
    if not SMALLEST_EXPONENT <= x <= LARGEST_EXPONENT:
        return 0.0 if x < 0 else x + np.inf
    doublings = (x * PER_LN2 + ROUND) - ROUND
    high, low = x - doublings * LN2, doublings * LN2_REST
    r = high - low
    z = r * r
    c = 6.61375632143793436117e-05 + z * (-1.65339022054652515390e-06 + z * 4.13813679705723846039e-08)
    c = r - z * (1.66666666666666019037e-01 + z * (-2.77777777770155933842e-03 + z * c))
    value = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    # Two factors, as 2¹⁰²⁴ overflows; a subnormal result is still rounded only once.
    first = int(doublings) >> 1
    return value * _power_of_two(first) * _power_of_two(int(doublings) - first)


@inlined
def _power_of_two(k):
    """2ᵏ for whole -1022 ≤ k ≤ 1023."""
    return np.int64((k + 1023) << 52).view(np.float64)


@inlined
def log(x):
    """ln x; minus infinity at 0, NaN below."""
    if not 0 < x < np.inf:
        return -np.inf if x == 0 else (np.nan if x < 0 else x)
    exponent = 0
    if x < SMALL:
        x, exponent = x * RESCALE, -600
    bits = int(np.float64(x).view(np.int64))
    exponent += (bits >> 52) - 1023
    m = np.int64((bits & FRACTION) | ONE).view(np.float64)
    if m > 2 * ROOT_HALF:
        m, exponent = 0.5 * m, exponent + 1
    f = m - 1.0
    half, s = 0.5 * f * f, f / (2.0 + f)
    z = s * s
    w = z * z
    odd = w * (3.999999999940941908e-01 + w * (2.222219843214978396e-01 + w * 1.531383769920937332e-01))
    even = 2.857142874366239149e-01 + w * (1.818357216161805012e-01 + w * 1.479819860511658591e-01)
    even = z * (6.666666666666735130e-01 + w * even)
    k = float(exponent)
    return ((s * (half + (even + odd)) + k * LN2_REST) - half) + f + k * LN2


@compiled
def _fill_exponentials(x, found):
    """found = eˣ, (n,)."""
    for k in range(len(x)):
        found[k] = exp(x[k])


def exponentials(x: np.ndarray) -> np.ndarray:
    """eˣ of every number of an array (n,)."""
    found = np.empty(len(x))
    _fill_exponentials(np.ascontiguousarray(x), found)
    return found


def each(function: Callable[[Any], float], values: ArrayLike) -> np.ndarray:
    """Apply a function of this module to every number of an array; for computations before a run."""
    numbers = np.asarray(values, dtype=float)
    return np.array([function(value) for value in numbers.ravel().tolist()]).reshape(numbers.shape)
