"""One Rosenbrock step (RODAS3) of a mechanical system, on traced scalars.

Source: A. Sandu, J. G. Verwer, J. G. Blom et al., "Benchmarking stiff ODE solvers
for atmospheric chemistry problems II: Rosenbrock solvers", Atmospheric Environment
31 (1997), method RODAS3: four stages, three evaluations, order 3(2), L-stable and
stiffly accurate. It is written here in the transformed form of Hairer and Wanner,
"Solving Ordinary Differential Equations II", IV.7:

    (I/(h*gamma) - J) u_i = f(t + alpha_i h, y + sum_j a_ij u_j)
                            + sum_j (c_ij/h) u_j + gamma_i h df/dt

The state is (q, y) with q' = y[:len(q)], so the positions are eliminated and only
the speeds (and what other first-order states there are) are solved for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

from workbench.symbolic.derive import derivative
from workbench.symbolic.expr import Expr, Scalar, Scalars, fma

GAMMA = 0.5
Pair = tuple[list[Scalar], list[Scalar]]
Rates = Callable[[Scalar, Scalars, Scalars, Scalar], Scalars]


def rodas3_step(
    rates: Rates, t: Expr, h: Expr, q: Sequence[Expr], y: Sequence[Expr], u: Expr, u_rate: Scalar, kept: int = 0
) -> tuple[list[Scalar], list[Scalar], list[Scalar], list[Scalar]]:
    """Advance (q, y) from t to t + h under the input u + u_rate * (time - t).

    `rates(t, q, y, u)` gives y'. All arguments are symbols, for the Jacobian is
    taken by them. The last `kept` of y are states that effects keep. Returns (q, y) at the
    end of the step and their error estimates, the distance to the embedded solution of order 2.
    """
    n, m = len(q), len(y)
    f0 = rates(t, q, y, u)
    memo: dict[tuple[int, int], Scalar] = {}
    f_q = [[derivative(f, x, memo) for x in q] for f in f0]
    f_y = [[derivative(f, x, memo) for x in y] for f in f0]
    f_t = [derivative(f, t, memo) + derivative(f, u, memo) * u_rate for f in f0]

    per_h = 1.0 / h  # the one division by the step
    gh = GAMMA * h
    g_q = [[gh * d for d in row] for row in f_q]
    matrix = [
        [((1.0 / GAMMA) * per_h if i == j else 0.0) - f_y[i][j] - (g_q[i][j] if j < n else 0.0) for j in range(m)]
        for i in range(m)
    ]
    apply = _solver(matrix, kept)

    def solve(rq: Scalars, ry: Scalars) -> Pair:
        uy = apply([_sum_of_products(g_q[i], rq, ry[i]) for i in range(m)])
        return [gh * (rq[i] + uy[i]) for i in range(n)], uy

    u1 = solve(y[:n], _combined(0.5 * h, f_t, f0))
    past = ([4.0 * w for w in u1[0]], [4.0 * w for w in u1[1]])
    u2 = solve(_combined(per_h, past[0], y[:n]), _combined(per_h, past[1], _combined(1.5 * h, f_t, f0)))
    y3 = _combined(2.0, u1[1], y)
    q3 = _combined(2.0, u1[0], q)
    end, u_end = t + h, u + u_rate * h
    past = (_minus(u1[0], u2[0]), _minus(u1[1], u2[1]))
    u3 = solve(_combined(per_h, past[0], y3[:n]), _combined(per_h, past[1], rates(end, q3, y3, u_end)))
    q4, y4 = _plus(q3, u3[0]), _plus(y3, u3[1])
    past = (_combined(-8.0 / 3.0, u3[0], past[0]), _combined(-8.0 / 3.0, u3[1], past[1]))
    u4 = solve(_combined(per_h, past[0], y4[:n]), _combined(per_h, past[1], rates(end, q4, y4, u_end)))
    return _plus(q4, u4[0]), _plus(y4, u4[1]), u4[0], u4[1]


def _plus(a: Scalars, b: Scalars) -> list[Scalar]:
    return [x + y for x, y in zip(a, b, strict=True)]


def _minus(a: Scalars, b: Scalars) -> list[Scalar]:
    return [x - y for x, y in zip(a, b, strict=True)]


def _combined(factor: Scalar, a: Scalars, b: Scalars) -> list[Scalar]:
    """factor a + b"""
    return [fma(factor, x, y) for x, y in zip(a, b, strict=True)]


def _sum_of_products(a: Scalars, b: Scalars, total: Scalar) -> Scalar:
    for x, y in zip(a, b, strict=True):
        total = fma(x, y, total)
    return total


def _solver(a: list[list[Scalar]], last: int = 0) -> Callable[[Scalars], list[Scalar]]:
    """right -> x of a x = right, without pivoting: the diagonal of I/(h gamma) - J dominates.

    Up to three unknowns by the inverse: nine products side by side, where elimination goes one after the other. Of
    more, the `last` ones (three, if not said) are eliminated first. What effects keep then leaves the plant's own
    equations as they are, to the last bit, where it does not act on them (its column in their rows is zero).
    """
    if not 0 < last < len(a):
        last = 3 if len(a) > 3 else 0
    n = len(a) - last
    if last == 0:
        inverse = _inverse(a)
        return lambda right: [_sum_of_products(row, right, 0.0) for row in inverse]
    behind = _solver([row[n:] for row in a[n:]])
    columns = [behind([row[j] for row in a[n:]]) for j in range(n)]  # of D^-1 C
    beside = [row[n:] for row in a[:n]]  # B
    first = _solver([[a[i][j] - _sum_of_products(beside[i], columns[j], 0.0) for j in range(n)] for i in range(n)])

    def apply(right: Scalars) -> list[Scalar]:
        z = behind(right[n:])
        x = first([r - _sum_of_products(b, z, 0.0) for r, b in zip(right[:n], beside, strict=True)])
        return [*x, *(w - _sum_of_products([c[k] for c in columns], x, 0.0) for k, w in enumerate(z))]

    return apply


def _inverse(a: list[list[Scalar]]) -> list[list[Scalar]]:
    """The inverse by cofactors, with one division."""
    m = len(a)
    if m == 0:
        return []
    if m == 1:
        return [[1.0 / a[0][0]]]
    if m == 2:
        per_det = 1.0 / (a[0][0] * a[1][1] - a[0][1] * a[1][0])
        return [[a[1][1] * per_det, -(a[0][1] * per_det)], [-(a[1][0] * per_det), a[0][0] * per_det]]
    others = ((1, 2), (2, 0), (0, 1))  # in this order cofactors need no sign
    cofactor = [[_minor(a, others[i], others[j]) for j in range(3)] for i in range(3)]
    per_det = 1.0 / _sum_of_products(a[0], cofactor[0], 0.0)
    return [[cofactor[j][i] * per_det for j in range(3)] for i in range(3)]


def _minor(a: list[list[Scalar]], rows: tuple[int, int], columns: tuple[int, int]) -> Scalar:
    (i, j), (k, n) = rows, columns
    return a[i][k] * a[j][n] - a[i][n] * a[j][k]
