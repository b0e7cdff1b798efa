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

from workbench.trace.derive import derivative
from workbench.trace.expr import Expr, Scalar

GAMMA = 0.5
Increment = tuple[list[Scalar], list[Scalar]]  # of positions and of speeds
Rates = Callable[[Scalar, Sequence[Scalar], Sequence[Scalar], Scalar], Sequence[Scalar]]


def rodas3_step(
    rates: Rates, t: Expr, h: Expr, q: Sequence[Expr], y: Sequence[Expr], u: Expr, u_rate: Scalar
) -> tuple[list[Scalar], list[Scalar], list[Scalar], list[Scalar]]:
    """Advance (q, y) from t to t + h under the input u + u_rate * (time - t).

    `rates(t, q, y, u)` gives y'. All arguments are symbols, for the Jacobian is
    taken by them. Returns (q, y) at the end of the step and their error estimates,
    the distance to the embedded solution of order 2.
    """
    n, m = len(q), len(y)
    f0 = rates(t, q, y, u)
    memo: dict[tuple[int, int], Scalar] = {}
    f_q = [[derivative(f, x, memo) for x in q] for f in f0]
    f_y = [[derivative(f, x, memo) for x in y] for f in f0]
    f_t = [derivative(f, t, memo) + derivative(f, u, memo) * u_rate for f in f0]

    per_h = 1.0 / h  # the one division by the step
    s = per_h * (1.0 / GAMMA)
    gh = GAMMA * h
    matrix = [
        [(s if i == j else 0.0) - f_y[i][j] - (f_q[i][j] * gh if j < n else 0.0) for j in range(m)] for i in range(m)
    ]
    lu = _factorise(matrix)

    def solve(rq: Sequence[Scalar], ry: Sequence[Scalar]) -> Increment:
        right = [ry[i] + gh * _dot(f_q[i], rq) for i in range(m)]
        uy = _substitute(lu, right)
        return [gh * (rq[i] + uy[i]) for i in range(n)], uy

    def stage(
        f: Sequence[Scalar], y_at: Sequence[Scalar], terms: Sequence[tuple[float, Increment]], ft: float
    ) -> Increment:
        rq: list[Scalar] = list(y_at[:n])
        ry: list[Scalar] = list(f)
        for factor, (uq, uy) in terms:
            rq = [r + (factor * per_h) * w for r, w in zip(rq, uq, strict=True)]
            ry = [r + (factor * per_h) * w for r, w in zip(ry, uy, strict=True)]
        if ft:
            ry = [r + ft * h * d for r, d in zip(ry, f_t, strict=True)]
        return solve(rq, ry)

    u1 = stage(f0, y, [], 0.5)
    u2 = stage(f0, y, [(4.0, u1)], 1.5)
    q3 = [a + 2.0 * b for a, b in zip(q, u1[0], strict=True)]
    y3 = [a + 2.0 * b for a, b in zip(y, u1[1], strict=True)]
    end, u_end = t + h, u + u_rate * h
    u3 = stage(rates(end, q3, y3, u_end), y3, [(1.0, u1), (-1.0, u2)], 0.0)
    q4 = [a + b for a, b in zip(q3, u3[0], strict=True)]
    y4 = [a + b for a, b in zip(y3, u3[1], strict=True)]
    u4 = stage(rates(end, q4, y4, u_end), y4, [(1.0, u1), (-1.0, u2), (-8.0 / 3.0, u3)], 0.0)
    return (
        [a + b for a, b in zip(q4, u4[0], strict=True)],
        [a + b for a, b in zip(y4, u4[1], strict=True)],
        u4[0],
        u4[1],
    )


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    total: Scalar = 0.0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def _factorise(a: list[list[Scalar]]) -> list[list[Scalar]]:
    """LU without pivoting; the diagonal holds the inverses of the pivots.

    The diagonal of I/(h gamma) - J dominates for the damped systems made here.
    """
    m = len(a)
    lu = [list(row) for row in a]
    for k in range(m):
        lu[k][k] = 1.0 / lu[k][k]
        for i in range(k + 1, m):
            lu[i][k] = lu[i][k] * lu[k][k]
            for j in range(k + 1, m):
                lu[i][j] = lu[i][j] - lu[i][k] * lu[k][j]
    return lu


def _substitute(lu: list[list[Scalar]], right: Sequence[Scalar]) -> list[Scalar]:
    m = len(lu)
    x = list(right)
    for i in range(m):
        for j in range(i):
            x[i] = x[i] - lu[i][j] * x[j]
    for i in reversed(range(m)):
        for j in range(i + 1, m):
            x[i] = x[i] - lu[i][j] * x[j]
        x[i] = x[i] * lu[i][i]
    return x
