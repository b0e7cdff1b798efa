"""An unknown cause as a law in a formula: few terms over speed, position, load and time, chosen on runs left out.

A sparse regression beside the base parameters. The terms are what a force at one place of the machine may depend on;
sets of them are built up one by one, the best few kept (J. A. Tropp, Greed is good, IEEE Transactions on Information
Theory 50, 2004), the number inside a term, such as where a step lies, refined as it comes in. The smallest set within
one standard error of the best one on held-out runs is taken (L. Breiman et al., Classification and Regression Trees,
1984, section 3.4.3). The law is written as an effect in a Python file that `load_effects` and machine.yaml accept.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted
from workbench.diagnose.hypotheses.free_parameters import base_parameters, bounds_of
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.machines import refitted_machine, with_effects
from workbench.diagnose.tables import TableFitter, gain_of, lever_of
from workbench.effects.loading import know
from workbench.effects.registry import UserFile, add
from workbench.machines import kind_of, machine_text
from workbench.simulate.driven import InverseSimulation, changed
from workbench.symbolic import expr

MOST_TERMS = 4
BEAM = 4  # sets of each size that are built on
LEAST_WAVES, MOST_WAVES = 3, 40  # halves of waves, whole waves along the distance passed; a bend is no wave
PLACES = 12  # where a step or a tight stretch is tried
HOLD = 10.0  # of the gap's size: a term's amplitude, one standard deviation; keeps what the runs do not show at zero
ROUNDS = 3  # Gauss-Newton steps on the driven machine with the law, whose wire may swing where a stiff one would not
STEP = 0.05  # of an amplitude: what the driven machine is simulated with to see what it shows of it
NEARLY = 0.03  # of what the best set takes away on held-out runs: a smaller set may take so much less
USEFUL = 0.1  # of the gap's energy beyond noise, on what was left out: a law that takes less is none
BEYOND = 0.5  # standard deviations off a base parameter's bounds: the law has a level of its own
DIGITS = 6


@dataclass(frozen=True)
class Term:
    """One or two columns of a law. code: of s, p and the numbers of `shape`, one expression a column; formula: the same
    for people. per: the unit behind the force's, as names end; size: of its amplitude. bounds: of the one number in
    `shape` that is refined; step: how far apart it was tried."""

    code: tuple[str, ...]
    formula: tuple[str, ...]
    per: str | tuple[str, ...]
    size: str | tuple[str, ...]
    shape: Mapping[str, float] = field(default_factory=dict)
    refined: str = ""
    step: float = 0.0

    @property
    def columns(self) -> list[tuple[str, str, str, str]]:
        """Of each column its code, its formula, `per` and `size`."""
        many = len(self.code)
        per, size = (x if isinstance(x, tuple) else (x,) * many for x in (self.per, self.size))
        return list(zip(self.texts(self.code), self.texts(self.formula), per, size, strict=True))

    def texts(self, forms: Sequence[str]) -> list[str]:
        numbers = {name: f"{value:.5g}" for name, value in self.shape.items()}
        return [form.format(**numbers).replace("− -", "+ ") for form in forms]


@dataclass(frozen=True, eq=False)
class Law:
    """terms; amplitudes, std: (columns,) of the force against forward motion, in the place's unit.

    acts_on: the place. before, after: rms on held-out runs, input's unit, without and with the law. explains: share of
    the gap's energy beyond noise on held-out runs. name: of the effect in `source`.
    """

    terms: tuple[Term, ...]
    amplitudes: Array
    std: Array
    acts_on: str
    unit: str
    before: float
    after: float
    explains: float
    name: str
    source: str
    machine: str  # machine.yaml with it, which needs `source`
    taken: Array  # (samples,) what it takes off the residual, on a stiff machine
    rms: float  # of the residual of `machine` with `source`, fitted to all runs

    @property
    def equation(self) -> str:
        """F = −(c1 v |v| + …), the force along forward motion."""
        return f"F = −({' + '.join(f'c{k} {text}'.removesuffix(' 1') for k, text in enumerate(self.formulas, 1))})"

    @property
    def values(self) -> list[tuple[str, float, float, str]]:
        """(name, value, standard error, unit) of each amplitude."""
        columns = [column for term in self.terms for column in term.columns]
        return [
            (f"c{k}", float(value), float(error), unit_of(unit_suffix(column, self.unit)))
            for k, (value, error, column) in enumerate(zip(self.amplitudes, self.std, columns, strict=True), 1)
        ]

    @property
    def formulas(self) -> list[str]:
        return [text for term in self.terms for text in term.texts(term.formula)]


def dictionary(problem: Problem, acts_on: str, rides: Sequence[SimpleNamespace]) -> list[Term]:
    """What a force at a place may depend on in these runs."""
    port = kind_of(problem.machine).ports[acts_on]
    v, m = f"s.{port.speed}", "rad" if port.speed == "w" or port.unit == "N m" else "m"
    force = "torque" if acts_on == "motor" else "force"
    speed = "motor_speed" if port.speed == "w" else "speed"
    speeds = {1: (f"s_per_{m}", f"{force}/{speed}"), 2: (f"s2_per_{m}2", f"{force}/{speed}*{speed}")}
    speeds[3] = (f"s3_per_{m}3", f"{force}/{speed}*{speed}*{speed}")
    terms = [
        Term((v,), ("v",), *speeds[1]),
        Term((f"absolute({v})",), ("|v|",), *speeds[1]),
        Term((f"{v} * absolute({v})",), ("v |v|",), *speeds[2]),
        Term((f"{v} * {v}",), ("v²",), *speeds[2]),
        Term((f"{v} * {v} * {v}",), ("v³",), *speeds[3]),
        Term(("1.0",), ("1",), "", force),
        Term(("s.switch",), ("sign v",), "", force),
    ]
    per_load = f"per_{'nm' if port.unit == 'N m' else 'n'}"
    if np.ptp(np.concatenate([np.abs(ride.load) for ride in rides])) > 0.0:
        terms += [
            Term(("absolute(s.load) * s.switch",), ("|load| sign v",), per_load, "1"),
            Term(("s.load",), ("load",), per_load, "1"),
            Term((f"absolute(s.load) * {v}",), ("|load| v",), f"s_per_{m}", f"1/{speed}"),
            Term((f"absolute(s.load) * {v} * absolute({v})",), ("|load| v |v|",), f"s2_per_{m}2",
                 f"1/{speed}*{speed}"),
        ]  # fmt: skip
    top = max(float(np.max(np.abs(getattr(ride, port.speed)))) for ride in rides)
    for part in (0.02, 0.05, 0.12, 0.25):
        terms.append(
            Term((f"exp(-({v} / {{v_s}}) * ({v} / {{v_s}})) * s.switch",), ("exp(−(v/{v_s})²) sign v",), "", force,
                 {"v_s": part * top}, "v_s", 0.6 * part * top)
        )  # fmt: skip
    x = np.concatenate([ride.x for ride in rides])
    low, high = float(np.min(x)), float(np.max(x))
    length = high - low
    if length > 0.0:
        xm = "rad" if kind_of(problem.machine).moved.unit == "rad" else "m"
        middle = {"x_m": 0.5 * (low + high)}
        for sign, said in (("", ""), (" * s.switch", " sign v")):
            linear, square = f"(s.x - {{x_m}}){sign}", f"(s.x - {{x_m}}) * (s.x - {{x_m}}){sign}"
            words = (f"(x − {{x_m}}){said}", f"(x − {{x_m}})²{said}", said.strip() or "1")
            codes = (linear, square, sign.removeprefix(" * ") or "1.0")
            terms.append(Term(codes[:1], words[:1], (f"per_{xm}",), (f"{force}/length",), middle))
            terms.append(Term(codes, words, (f"per_{xm}", f"per_{xm}2", ""),
                              (f"{force}/length", f"{force}/length*length", force), middle))  # fmt: skip
        terms.append(Term((f"s.x * {v}",), ("x v",), f"s_per_{m}2" if m == xm else f"s_per_{m}_{xm}",
                          f"{force}/{speed}*length"))  # fmt: skip
        gap = length / PLACES
        for place in low + gap * (0.5 + np.arange(PLACES)):
            at = {"x_0": float(place), "b": 0.02 * length}
            near = {"x_0": float(place), "b": 0.5 * gap}
            for sign, said in (("", ""), (" * s.switch", " sign v")):
                terms += [
                    Term((f"clip((s.x - {{x_0}}) / {{b}} + 0.5, 0.0, 1.0){sign}",), (f"step(x − {{x_0}}){said}",), "",
                         force, at, "x_0", gap),
                    Term((f"exp(-0.5 * ((s.x - {{x_0}}) / {{b}}) * ((s.x - {{x_0}}) / {{b}})){sign}",),
                         (f"exp(−½((x − {{x_0}})/{{b}})²){said}",), "", force, near, "x_0", gap),
                ]  # fmt: skip
        resolved = (
            0.5 * top * (length / max(length, 1e-300)) / problem.band_hz
        )  # the shortest wave that passes the band
        if port.speed == "w":
            resolved *= kind_of(problem.machine).transmission_of(problem.machine)
        for half in range(LEAST_WAVES, 2 * MOST_WAVES + 1):
            d = 2.0 * length / half
            if d < resolved:
                break
            for sign, said in (("", ""), (" * s.switch", " sign v")):
                terms.append(
                    Term(tuple(f"{f}(s.x * (6.283185307179586 / {{d}})){sign}" for f in ("cos", "sin")),
                         tuple(f"{f}(2π x/{{d}}){said}" for f in ("cos", "sin")), "", force, {"d": d}, "d",
                         0.5 * d * d / length)
                )  # fmt: skip
    latest = max(float(np.max(ride.t)) for ride in rides)
    clocks = [("s.t", "t", latest)]
    if len({run.start_time_s for run in problem.runs}) > 1:
        last = latest + max(run.start_time_s for run in problem.runs)
        clocks.append(("(s.t + p.start_time_s)", "T", last))
    for clock, said_t, whole in clocks:
        for sign, said in (("", ""), (" * s.switch", " sign v")):
            terms.append(Term((f"{clock}{sign}",), (f"{said_t}{said}",), "per_s", force))
            for part in (0.1, 0.3, 1.0):
                terms.append(
                    Term((f"exp(-{clock} / {{tau}}){sign}",), (f"exp(−{said_t}/{{tau}}){said}",), "", force,
                         {"tau": part * whole}, "tau", 0.6 * part * whole)
                )  # fmt: skip
    return terms


def rides_at(problem: Problem, setting: Mapping[str, Any], acts_on: str) -> list[tuple[SimpleNamespace, Any]]:
    """Of each run the signals at the place, along the simulated motion, and its parameters."""
    bench, kind = problem.bench, kind_of(problem.machine)
    port, rides = kind.ports[acts_on], []
    chosen = []
    for j in range(len(problem.runs)):
        known = {key: value for key, value in setting.items() if hasattr(bench.base[j], key)}
        chosen.append(changed(bench.base[j], {k: v[j] if isinstance(v, tuple) else v for k, v in known.items()}))
    predicted = bench.predict([chosen])[0]
    for run, motion, (force, others), p in zip(problem.runs, bench.motions, predicted, chosen, strict=True):
        frame = kind.frame(run, motion.position, motion.speed, others, p)
        here = changed(p, {"start_time_s": run.start_time_s - run.time_s[0]})
        frame.switch = port.way(frame, here)
        if acts_on == "guide":
            frame.load = np.full(len(run.time_s), p.s_p * p.m_p * p.g)
        elif acts_on == "motor":
            frame.load, _ = kind.transmitted(p, frame, force, motion.acceleration, run.payload_kg)
        else:
            frame.load = getattr(p, "G", 0.0) * np.sin(frame.x) + getattr(p, "C", 0.0) + 0.0 * frame.x
        rides.append((frame, here))
    return rides


def columns(
    problem: Problem, rides: Sequence[tuple[Any, Any]], terms: Sequence[Term], acts_on: str, gain: float
) -> Array:
    """(samples, columns) the change of the predicted input by each term's column at an amplitude of one."""
    functions = {name: getattr(expr, name) for name in ("absolute", "clip", "cos", "sin", "exp")}
    codes = [compile(text, "<term>", "eval") for term in terms for text in term.texts(term.code)]
    torque, tension = [], []
    for j, ((s, p), run) in enumerate(zip(rides, problem.runs, strict=True)):
        forces = np.empty((len(run.time_s), len(codes)))
        for k, code in enumerate(codes):
            forces[:, k] = eval(code, {"__builtins__": {}, "s": s, "p": p, **functions})
        smooth = problem.smooth_at(j)(forces)
        torque.append(gain * lever_of(problem.machine, acts_on) * smooth)
        if j in problem.tension:
            share = kind_of(problem.machine).ports[acts_on].share
            tension.append(share * problem.noise / problem.tension_noise * smooth)
    return np.concatenate([*torque, *tension])


class Regression:
    """Terms beside the base parameters, linearly: least squares on all groups, and on all but one."""

    def __init__(self, problem: Problem, fitter: TableFitter, residual: Array, z: Array, size: float) -> None:
        self.problem, self.fitter, self.z, self.size = problem, fitter, z, size
        self.base = len(z)
        self.fixed = np.column_stack([-fitter.jacobian, residual])
        self.white = problem.errors.whiten(self.fixed)

    def normal(self, columns: Array) -> tuple[Array, Array, Array]:
        """(groups, k, k), (groups, k) and (groups,) of whitened rows: base parameters first, then the columns."""
        whole = np.column_stack([self.white[:, :-1], self.problem.errors.whiten(columns)])
        r, groups = self.white[:, -1], self.fitter.groups
        parts = [(whole[groups == g], r[groups == g]) for g in range(self.fitter.count)]
        return (
            np.array([x.T @ x for x, _ in parts]),
            np.array([x.T @ y for x, y in parts]),
            np.array([y @ y for _, y in parts]),
        )

    def solve(
        self, normal: tuple[Array, Array, Array], sets: Sequence[Sequence[int]], at: Array | None = None
    ) -> tuple[Array, Array, Array]:
        """Of each set of columns (all of one length): the solution (sets, base + columns), those without each group
        (sets, groups, …), and the held-out sums of squares (sets, groups). at: amplitudes that the residual holds."""
        n, b, yy = normal
        chosen = self.base + np.array(sets, dtype=int).reshape(len(sets), -1)
        which = np.hstack([np.tile(np.arange(self.base), (len(sets), 1)), chosen])
        n, b = n[:, which[:, :, None], which[:, None, :]], b[:, which]  # (groups, sets, k, k), (groups, sets, k)
        every = n.sum(0)
        scale = np.einsum("sii->si", every)[:, self.base :] / max(len(self.white), 1)
        hold = np.hstack([np.tile(1.0 / self.fitter.std**2, (len(sets), 1)), scale / (HOLD * self.size) ** 2])
        pull = hold * np.concatenate([self.z, np.zeros(chosen.shape[1]) if at is None else at])
        held = every + hold[:, :, None] * np.eye(which.shape[1])
        whole = solved(held, b.sum(0) - pull)
        others = solved(held - n, b.sum(0) - b - pull)  # (groups, sets, k)
        left = (
            yy[:, None] - 2.0 * np.einsum("gsk,gsk->gs", others, b) + np.einsum("gsk,gskl,gsl->gs", others, n, others)
        )
        return whole, others.transpose(1, 0, 2), np.maximum(left, 0.0).T


def solved(matrices: Array, targets: Array) -> Array:
    """(…, k) of symmetric matrices (…, k, k); the smallest solution where these runs leave a direction open."""
    try:
        found = np.linalg.solve(matrices, targets[..., None])
    except np.linalg.LinAlgError:
        found = np.linalg.pinv(matrices, rcond=1e-12, hermitian=True) @ targets[..., None]
    return np.asarray(found[..., 0], dtype=float)


def find_law(problem: Problem, fitted: Fitted, acts_on: str, name: str = "measured_law") -> Law | None:
    """The law at a place, None where none holds on what was left out. fitted: the base parameters' own fit."""
    fitter = TableFitter(problem, fitted)
    setting = replace(fitted, z=fitter.z).setting
    gain, rides = gain_of(problem, setting), rides_at(problem, setting, acts_on)
    size = fitted.rms(problem.inputs)
    start = Regression(problem, fitter, fitter.residual, fitter.z, size / max(problem.noise, 1e-300))
    terms = dictionary(problem, acts_on, [s for s, _ in rides])
    x = columns(problem, rides, terms, acts_on, gain)
    tried: dict[tuple[int, ...], Array] = {(): start.solve(start.normal(x[:, :1]), [()])[2][0]}
    beam: list[tuple[int, ...]] = [()]
    for _ in range(MOST_TERMS):
        normal, first = start.normal(x), np.cumsum([0, *(len(term.code) for term in terms)])
        new = dict.fromkeys(
            tuple(sorted({*chosen, k})) for chosen in beam for k in range(len(terms)) if k not in chosen
        )
        by_size: dict[int, list[tuple[tuple[int, ...], list[int]]]] = {}
        for key in new:
            wanted = [c for k in key for c in range(first[k], first[k + 1])]
            by_size.setdefault(len(wanted), []).append((key, wanted))
        for same in by_size.values():
            for (key, _), left in zip(same, start.solve(normal, [wanted for _, wanted in same])[2], strict=True):
                tried[key] = left
        before, beam = beam, sorted(new, key=lambda key: float(tried[key].sum()))[:BEAM]
        finer = []  # the same sets with the inner number of what was added refined
        for key in beam:
            added = next((k for k in key if terms[k].refined and not any(k in b for b in before)), None)
            if added is None:
                continue
            better, left = _refined(problem, start, rides, gain, acts_on, [terms[k] for k in key], key.index(added))
            if left.sum() < tried[key].sum():
                terms.append(better)
                x = np.column_stack([x, columns(problem, rides, [better], acts_on, gain)])
                finer.append(tuple(sorted({*key} - {added} | {len(terms) - 1})))
                tried[finer[-1]] = left
        beam = sorted([*finer, *beam], key=lambda key: float(tried[key].sum()))[:BEAM]
        lowest = min(float(left.sum()) for left in tried.values())
        if min(float(tried[key].sum()) for key in before) - lowest < NEARLY * (float(tried[()].sum()) - lowest):
            break
    alone, least = tried[()], min(tried.values(), key=lambda left: float(left.sum()))
    spared = NEARLY * float((alone - least).sum())

    def good(left: Array) -> bool:
        more = left - least
        return float(more.sum()) <= max(math.sqrt(len(more) * float(np.var(more, ddof=1))), spared)

    def cost(key: tuple[int, ...]) -> tuple[int, float]:
        return sum(len(terms[k].code) + len(terms[k].shape) for k in key), float(tried[key].sum())

    chosen = min((key for key, left in tried.items() if good(left)), key=cost)
    if not chosen:
        return None
    law = [terms[k] for k in chosen]
    low, high, _ = bounds_of(fitted.free)
    levels = [term for words in ("sign v", "1") for term in terms if term.formula == (words,) and term not in law]
    for level in levels:
        x = columns(problem, rides, law, acts_on, gain)
        base = start.solve(start.normal(x), [range(x.shape[1])])[0][0][: start.base]
        # A mean that no tolerance of the machine holds.
        if np.any((base < low - BEYOND) | (base > high + BEYOND)):
            law.append(level)
    return _finished(problem, fitted, start, rides, gain, acts_on, law, name)


def _refined(
    problem: Problem,
    start: Regression,
    rides: Sequence[tuple[Any, Any]],
    gain: float,
    acts_on: str,
    terms: Sequence[Term],
    k: int,
) -> tuple[Term, Array]:
    """Term k of a set with its inner number at the least residual on held-out groups, and that residual's squares."""
    term = terms[k]
    at = term.shape[term.refined]
    others = columns(problem, rides, [*terms[:k], *terms[k + 1 :]], acts_on, gain)
    found: dict[float, Array] = {}

    def left(value: float) -> float:
        x = columns(problem, rides, [replace(term, shape={**term.shape, term.refined: value})], acts_on, gain)
        x = np.column_stack([others, x])
        found[value] = start.solve(start.normal(x), [range(x.shape[1])])[2][0]
        return float(found[value].sum())

    lowest = max(at - term.step, 0.1 * at) if at > 0.0 else at - term.step
    minimize_scalar(
        left, bounds=(lowest, at + term.step), method="bounded", options={"maxiter": 14, "xatol": 1e-3 * term.step}
    )
    best = min(found, key=lambda value: float(found[value].sum()))
    return replace(term, shape={**term.shape, term.refined: best}), found[best]


def _finished(
    problem: Problem,
    fitted: Fitted,
    start: Regression,
    rides: Sequence[tuple[Any, Any]],
    gain: float,
    acts_on: str,
    terms: list[Term],
    name: str,
) -> Law | None:
    """The chosen terms with their inner numbers refined and their amplitudes fitted in the driven simulation."""

    x = columns(problem, rides, terms, acts_on, gain)
    base, lowest, highest = start.base, *bounds_of(fitted.free)[:2]
    keys = base_parameters(problem.machine, problem.logged)
    port = kind_of(problem.machine).ports[acts_on]
    solved, withouts, _ = start.solve(start.normal(x), [range(x.shape[1])])
    shown, others = solved[0], withouts[0]
    source = source_of(terms, port, kind_of(problem.machine).plant.kind, acts_on, name)
    file = UserFile(f"{name}.py", source.encode())
    groups = start.fitter.groups[: problem.inputs]
    try:
        effect = know(file)[0]
        names = [p.named(kind_of(problem.machine).plant.kind) for p in effect.parameters]

        def machine_at(solution: Array) -> Any:
            z = np.clip(solution[:base], lowest, highest)
            plain = refitted_machine(problem, keys, replace(fitted, z=z))
            amplitudes = {n: _rounded(a) for n, a in zip(names, solution[base:], strict=True)}
            return with_effects(plain, {**plain.effects, name: amplitudes})

        def residual(solution: Array) -> Array:
            balances = InverseSimulation(machine_at(solution), problem.runs, problem.band_hz).balances()
            return np.concatenate([b.residual[rows] for b, rows in zip(balances, problem.rows, strict=True)])

        best = shown
        rows = residual(best)
        for _ in range(ROUNDS if not problem.has_tension else 0):
            z, c = np.clip(best[:base], lowest, highest), best[base:]
            start.fitter.move_to(z)
            again = Regression(problem, start.fitter, rows, z, start.size)
            size_of = np.maximum(np.abs(c), STEP * float(np.max(np.abs(c))))
            shifts = np.pad(np.diag(STEP * size_of), ((0, 0), (base, 0)))
            shown_by = [(rows - residual(np.concatenate([z, c]) + shift)) / np.sum(shift) for shift in shifts]
            steps, without, _ = again.solve(again.normal(np.column_stack(shown_by)), [range(len(c))], c)
            moved = np.concatenate([z, c]) + steps[0]
            fresh = residual(moved)
            if np.sum(fresh**2) >= np.sum(rows**2):
                break
            best, rows, others = moved, fresh, np.concatenate([z, c]) + without[0]

        def held_out(solutions: Array) -> float:
            unseen = np.empty(problem.inputs)
            for g, solution in enumerate(solutions):
                unseen[groups == g] = residual(solution)[groups == g]
            return float(np.sqrt(np.mean(unseen**2)))

        alone = start.solve(start.normal(x), [()])[1][0]
        before = held_out(np.hstack([alone, np.zeros((len(alone), x.shape[1]))]))
        before = min(before, float(np.sqrt(np.sum(start.fitter.before) / problem.inputs)))
        after = held_out(others)
        text = machine_text(machine_at(best))
    except InputError:  # base values that no machine has: the linear fit has led too far
        return None
    finally:
        add([], name, file)
    gap = before**2 - problem.noise**2
    explains = (before**2 - after**2) / gap if gap > 0.0 else 0.0
    spread = others[:, base:] - others[:, base:].mean(axis=0)
    std = np.sqrt((len(others) - 1) / len(others) * np.sum(spread**2, axis=0))
    if explains < USEFUL:
        return None
    return Law(
        tuple(terms), best[base:], std, acts_on, port.unit, before, after, explains, name, source, text,
        x @ shown[base:], float(np.sqrt(np.mean(rows**2))),
    )  # fmt: skip


def source_of(terms: Sequence[Term], port: Any, kind: str, acts_on: str, name: str) -> str:
    """The text of a Python file that declares the law as an effect."""
    parameters, parts, said = [], [], []
    for k, (code, text, per, size) in enumerate([column for term in terms for column in term.columns], 1):
        unit = unit_suffix((code, text, per, size), port.unit)
        parameters.append(
            f'        Parameter("c{k}", "c{k}_{unit}", "of {text}", "{size}", -100.0, 100.0, 0.02, 0.0, '
            "vanishes_at=0.0),"
        )
        parts.append(f"e.c{k} * ({code})")
        said.append(f"c{k} {text}".removesuffix(" 1"))
    used = sorted({f for f in ("absolute", "clip", "cos", "sin", "exp") if any(f"{f}(" in p for p in parts)})
    imported = f"from workbench.symbolic.expr import {', '.join(used)}\n" if used else ""
    equation = "F = −(" + " + ".join(said) + ")"
    body = "\n        + ".join(parts)
    return f'''"""A law that `workbench diagnose` found in the residual of a campaign; its cause is not known."""

{imported}from workbench.effects import Parameter, effect


@effect(
    place={{"{kind}": "{port.place}"}},
    subsystem="{acts_on}",
    regime="all",
    parameters=[
{chr(10).join(parameters)}
    ],
    equation="{equation}",
    reference="sparse regression on the campaign's own runs, chosen on runs left out",
    shows="{port.unit} against forward motion, within the range of the runs that it was found in",
    listed=False,
)
def {name}(s, e, p):
    """{equation}"""
    return -(
        {body}
    )
'''


def unit_of(suffix: str) -> str:
    """n_s2_per_m2 as N s²/m²; "" for a plain number."""
    if suffix == "fraction":
        return ""
    over, _, under = suffix.partition("per_")

    def said(part: str) -> str:
        words = {"n": "N", "nm": "N m"}
        raised = str.maketrans("23", "²³")
        return " ".join(words.get(word, word.translate(raised)) for word in part.strip("_").split("_") if word)

    below = f"({said(under)})" if "_" in under else said(under)
    return f"{said(over) or '1'}/{below}" if under else said(over)


def unit_suffix(column: tuple[str, str, str, str], force_unit: str) -> str:
    """The end of an amplitude's name: its unit."""
    _, _, per, size = column
    if size == "1":
        return "fraction"
    return per if size.startswith("1/") else f"{'nm' if force_unit == 'N m' else 'n'}_{per}".rstrip("_")


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
