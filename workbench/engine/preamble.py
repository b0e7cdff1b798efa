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


@njit(forceinline=True, error_model="numpy")
def atan_(x):
    """Cephes' atan: three ranges and a rational function, within 2e-16."""
    a = abs(x)
    far = a > 2.414213562373095
    mid = a > 0.66
    num = select(far, -1.0, select(mid, a - 1.0, a))
    den = select(far, a, select(mid, a + 1.0, 1.0))
    offset = select(far, 1.5707963267948966, select(mid, 0.7853981633974483, 0.0))
    z = num / den
    s = z * z
    p = -8.750608600031904122785e-1
    p = p * s - 1.615753718733365076637e1
    p = p * s - 7.500855792314704667340e1
    p = p * s - 1.228866684490136173410e2
    p = p * s - 6.485021904942025371773e1
    q = s + 2.485846490142306297962e1
    q = q * s + 1.650270098316988542046e2
    q = q * s + 4.328810604912902668951e2
    q = q * s + 4.853903996359136964868e2
    q = q * s + 1.945506571482613964425e2
    r = offset + (z * (s * p / q) + z)
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
