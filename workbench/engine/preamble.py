"""Branch-free elementary functions; their text opens every generated kernel.

numba turns `a if c else b` into a branch and a call of the C library into a barrier
to vectorisation; `select` and these polynomials keep a lane loop vectorisable.
"""

from __future__ import annotations

PREAMBLE = '''
import math

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic


@intrinsic
def select(context, condition, a, b):
    """a where the condition holds, b elsewhere, without a branch."""

    def generate(context, builder, signature, args):
        flag = args[0]
        if flag.type != ir.IntType(1):
            flag = builder.trunc(flag, ir.IntType(1))
        return builder.select(flag, args[1], args[2])

    return types.float64(types.boolean, types.float64, types.float64), generate


@intrinsic
def fma_(context, a, b, c):
    """a b + c with one rounding, the same whatever the compiler makes of its surroundings."""

    def generate(context, builder, signature, args):
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), generate


@njit(forceinline=True, error_model="numpy")
def atan_(x):
    """atan within 3e-16: three ranges, one division, a polynomial in pairs so that little waits for little.

    z (1 + s Q(s)), s = z^2 up to tan(pi/8)^2: minimax by Remez' points at 40 digits, 1.3e-18.
    """
    a = abs(x)
    far = a > 2.414213562373095
    mid = a > 0.41421356237309503
    num = select(far, -1.0, select(mid, a - 1.0, a))
    den = select(far, a, select(mid, a + 1.0, 1.0))
    offset = select(far, 1.5707963267948966, select(mid, 0.7853981633974483, 0.0))
    z = num / den
    s = z * z
    s2 = s * s
    s4 = s2 * s2
    a0 = fma_(0.19999999999940837, s, -0.3333333333333312)
    a1 = fma_(0.11111110744657099, s, -0.14285714279244968)
    a2 = fma_(0.07692045194561481, s, -0.09090896801472813)
    a3 = fma_(0.05846866752275139, s, -0.06662950246036792)
    a4 = fma_(0.03796390316111083, s, -0.05035049795312439)
    b0 = fma_(a1, s2, a0)
    b1 = fma_(a3, s2, a2)
    b2 = fma_(-0.017803896394812564, s2, a4)
    q = fma_(b2, s4 * s4, fma_(b1, s4, b0))
    r = offset + fma_(z * s, q, z)
    return select(x < 0.0, -r, r)


@njit(forceinline=True, error_model="numpy")
def sin_(x):
    return math.sin(x)


@njit(forceinline=True, error_model="numpy")
def cos_(x):
    return math.cos(x)


@njit(forceinline=True, error_model="numpy")
def exp_(x):
    return math.exp(x)


@njit(forceinline=True, error_model="numpy")
def sqrt_(x):
    return math.sqrt(x)


@njit(forceinline=True, error_model="numpy")
def floor_(x):
    return math.floor(x)
'''
