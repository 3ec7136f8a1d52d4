"""Sine and cosine by plain arithmetic, for compiled kernels.

x = k pi + r with |r| <= pi / 2, then sin x = (-1)^k sin r and cos x = (-1)^k cos r, by two polynomials in r^2 that
share the reduction. Nothing branches and nothing is looked up, so a compiler keeps whole vectors of states in
registers; calls of a library's sine and cosine would interrupt them twice an angle. Measured against heyoka's (with
SLEEF) by `scripts.benchmarks.kernels --sine`, forward dynamics of columns of states on one thread: arm 3.8 ns a state
against 5.7 ns (50 % slower), Panda 35 ns against 39 to 42 ns (12 to 17 % slower).

k is rounded by adding and subtracting 1.5 * 2^52, where neighbouring doubles are 1 apart. k pi is subtracted in three
parts, the leading two of 32 bits, so that their products with k are exact below k = 2^21: the reduction of Cody and
Waite 1980, "Software Manual for the Elementary Functions". The polynomials are minimax (Remez's exchange) in the
absolute error of the sine and the cosine on 0 <= r^2 <= 1.0001 (pi / 2)^2, the margin being for the rounding of k, with
the leading terms r, 1 and -r^2 / 2 fixed.
"""

from twolink.algorithms.spatial import Scalar

LIMIT = 1e6
"""rad: up to this |x| the absolute error of either answer is at most 4e-16 (measured: 2.4e-16, 3.4e-16).

The products of k with the leading parts of pi stay exact up to 2^21 pi = 6.6e6; this keeps a factor of 6 from there.
"""

_ROUND = 6755399441055744.0  # 1.5 * 2^52
_INVERSE_PI = 0.3183098861837907
_PI = (3.1415926534682512, 1.2154201012607932e-10, 4.044532497591901e-21)

# sin r = r + r^3 S(r^2): error 2e-19. cos r = 1 - r^2 / 2 + r^4 C(r^2): error 6e-18. The constant term is the first.
_SIN = (
    -0.16666666666666666,
    0.008333333333333115,
    -0.00019841269841185916,
    2.7557319207779548e-06,
    -2.505210660597676e-08,
    1.605892780373394e-10,
    -7.642712083562756e-13,
    2.7184875231549606e-15,
)
_COS = (
    0.04166666666666583,
    -0.0013888888888830076,
    2.4801587285786695e-05,
    -2.7557317068548416e-07,
    2.087659258309319e-09,
    -1.1463634914557878e-11,
    4.6161268699764185e-14,
)


def sin_cos(x: Scalar) -> tuple[Scalar, Scalar]:
    """(sin x, cos x) of floats, NumPy arrays or heyoka expressions, x in rad, |x| <= LIMIT. NaN for NaN and infinities.

    Exactly odd and even, with sin 0 = 0 and cos 0 = 1. Expressions must be compiled without fast_math, which cancels
    the addition and subtraction that round k; contraction to fused operations, heyoka's default, does no harm.
    """
    k = (x * _INVERSE_PI + _ROUND) - _ROUND
    r = (x - k * _PI[0]) - (k * _PI[1] + k * _PI[2])  # the small parts together: r is rounded once, not twice
    half = k * 0.5
    odd = half - ((half + _ROUND) - _ROUND)  # 0 for an even k, 1/2 or -1/2 for an odd one
    sign = 1.0 - 8.0 * (odd * odd)
    z = r * r
    sine = r + r * (z * _polynomial(_SIN, z))
    return sign * sine, sign * (1.0 + z * (z * _polynomial(_COS, z) - 0.5))


def _polynomial(coefficients: tuple[float, ...], z: Scalar) -> Scalar:
    """Horner's rule; the constant term is the first."""
    value: Scalar = coefficients[-1]
    for coefficient in reversed(coefficients[:-1]):
        value = value * z + coefficient
    return value
