"""Branch-free elementary functions; their text opens every generated kernel.

A branch, or a call of the C library, is a barrier to vectorisation; `select` and these polynomials keep a lane loop
vectorisable. `select`, `fma_`, `bits`, `number`, `abs`, `sqrt_` and `floor_` are the compiler's own (`native`).
"""

from __future__ import annotations

PREAMBLE = '''def atan_(x):
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


def nearest_(x):
    """The nearest whole number, for |x| < 2^51: the mantissa has no room for more."""
    return (x + 6755399441055744.0) - 6755399441055744.0


def sine_of_rest(n, x):
    """(-1)^m sin(x - n pi) for n = m or m + 1/2, |x - n pi| <= pi/2; pi in four parts, coefficients of SLEEF's sin."""
    r = x - n * 3.1415926218032836914
    r = r - n * 3.1786509424591713469e-08
    r = r - n * 1.2246467864107188502e-16
    r = r - n * 1.2736634327021899816e-24
    s = r * r
    p = -7.97255955009037868891952e-18
    p = p * s + 2.81009972710863200091251e-15
    p = p * s - 7.64712219118158833288484e-13
    p = p * s + 1.60590430605664501629054e-10
    p = p * s - 2.50521083763502045810755e-08
    p = p * s + 2.75573192239198747630416e-06
    p = p * s - 0.000198412698412696162806809
    p = p * s + 0.00833333333333332974823815
    p = p * s - 0.166666666666666657414808
    return r + r * (s * p)


def sign_of_turn(m):
    """(-1)^m for a whole number m."""
    return 1.0 - 2.0 * abs(m - 2.0 * nearest_(m * 0.5))


def sin_(x):
    """sin(x), within 3e-16 for |x| < 1e6."""
    m = nearest_(x * 0.3183098861837906715)
    return sign_of_turn(m) * sine_of_rest(m, x)


def cos_(x):
    """cos(x), within 3e-16 for |x| < 1e6: sin(x + pi/2), the quarter turn taken into the reduction."""
    m = nearest_(x * 0.3183098861837906715 + 0.5)
    return sign_of_turn(m) * sine_of_rest(m - 0.5, x)


def exp_(x):
    """exp(x), within 4e-16 relative; 0 below -708, exp(709) above 709."""
    y = select(x > 709.0, 709.0, select(x < -708.0, -708.0, x))
    n = nearest_(y * 1.4426950408889634074)
    r = y - n * 0.69314718055966295651160180568695068359375
    r = r - n * 0.28235290563031577122588448175013436025525412068e-12
    p = 1.6059043836821614599e-10
    p = p * r + 2.0876756987868098979e-09
    p = p * r + 2.5052108385441718775e-08
    p = p * r + 2.7557319223985890653e-07
    p = p * r + 2.7557319223985890653e-06
    p = p * r + 2.4801587301587301587e-05
    p = p * r + 1.9841269841269841270e-04
    p = p * r + 1.3888888888888888889e-03
    p = p * r + 8.3333333333333333333e-03
    p = p * r + 4.1666666666666666667e-02
    p = p * r + 1.6666666666666666667e-01
    p = p * r + 0.5
    power = number(bits(n + 6755399441056767.0) << 52)  # 2^n: n + 1023 moved to the exponent's place
    return select(x < -708.0, 0.0, power * (p * (r * r) + r + 1.0))
'''
