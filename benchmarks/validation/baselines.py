"""What a user might do instead of the diagnosis: answers of simpler methods to the same campaigns."""

from __future__ import annotations

import importlib.util
import math
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from workbench.blind.measures import kind_of as kind_of_row
from workbench.machines import kind_of
from workbench.simulate.lowpass import lowpass

if TYPE_CHECKING:
    from workbench.core.run import Array
    from workbench.diagnose.hypotheses.problem import Problem
    from workbench.diagnose.hypotheses.search import SearchResult

Row = Mapping[str, Any]
Said = tuple[str, tuple[str, ...]]  # verdict and names
TRAINING = "largest drop of the training error"
BIC = "BIC alone"
SPARSE = "sparse regression of the residual (pysindy)"
COMMONEST = "always the commonest answer"

SHARE = 0.5  # of what the first term explains: a second one that explains as much counts as an effect of its own
LOW_SPEED = 0.05  # of the fastest: where Stribeck's peak turns
WARM_S = 200.0


def training_error(row: Row) -> Said:
    """The single effect whose fit leaves the least chi-squared; it always names one."""
    singles = [fit for fit in row["weighed"] if len(fit["names"]) == 1]
    if not singles:
        return "no_gap", ()
    return "named", tuple(min(singles, key=lambda fit: float(fit["chi2"]))["names"])


def bic(row: Row) -> Said:
    """The least chi^2 + k ln n of no effect, one and two (G. Schwarz, Annals of Statistics 6, 1978); no unknown."""
    if not row.get("none"):
        return "no_gap", ()
    cost = math.log(max(float(row["none"]["samples"]), 2.0))
    scores: dict[tuple[str, ...], float] = {(): float(row["none"]["chi2"])}
    for fit in row["weighed"]:
        if fit["names"]:
            scores[tuple(fit["names"])] = float(fit["chi2"]) + cost * float(fit["parameters"])
    best = min(scores, key=lambda names: scores[names])
    return ("named", best) if best else ("no_gap", ())


def sparse(row: Row) -> Said | None:
    """What pysindy named when the campaign was diagnosed; None where it was not installed."""
    names = row.get("sparse")
    if names is None:
        return None
    return ("named", tuple(names)) if names else ("no_gap", ())


def commonest(rows: Sequence[Row]) -> Callable[[Row], Said]:
    """The answer that most labels of a kind of machine ask for, given to all of it; it has seen the labels."""

    def asked(row: Row) -> Said:
        effects = tuple(sorted(row["label"]["effects"]))
        unlisted = any("unlisted" in name for name in effects)
        return ("unknown", ()) if unlisted else ("named", effects) if effects else ("no_gap", ())

    best = {}
    for kind in {kind_of_row(row) for row in rows}:
        counts = Counter(asked(row) for row in rows if kind_of_row(row) == kind)
        best[kind] = max(counts, key=lambda said: (counts[said], said))
    return lambda row: best[kind_of_row(row)]


def baselines(rows: Sequence[Row]) -> dict[str, list[dict[str, Any]]]:
    """method -> the rows with its answers in place of the diagnosis'; methods that answered nothing are left out."""
    methods: dict[str, Callable[[Row], Said | None]] = {
        TRAINING: training_error,
        BIC: bic,
        SPARSE: sparse,
        COMMONEST: commonest(rows),
    }
    answers = {}
    for name, method in methods.items():
        said = [(row, method(row)) for row in rows]
        given = [_instead(row, answer) for row, answer in said if answer is not None]
        if given:
            answers[name] = given
    return answers


def _instead(row: Row, said: Said) -> dict[str, Any]:
    word, names = said
    ranking = [[word, list(names), 1.0]]
    return {**row, "word": word, "names": list(names), "alike": [], "ranking": ranking, "places": [], "subsystem": ""}


# Sparse regression: term -> what it is called in the library, on a hoist and on an axis.
_NAMES: Mapping[str, tuple[str, str]] = {
    "1": ("torque_offset", "torque_offset"),
    "sgn v": ("friction_coulomb", "friction_coulomb"),
    "v": ("friction_viscous", "friction_viscous"),
    "v |v|": ("", ""),  # no listed effect
    "a": ("gearbox_inertia", "inertia_error"),
    "sgn v low": ("friction_stribeck", "friction_stribeck"),
    "sgn v cold": ("friction_thermal_drift", "friction_thermal_drift"),
    "u": ("torque_scale", "torque_scale"),
    "u sgn v": ("gearbox_efficiency", "gearbox_efficiency"),
    "du/dt": ("torque_filter", "torque_filter"),
    "payload": ("payload_mass_error", ""),
    "payload sgn v": ("friction_load_dependent", ""),
    "x": ("wire_mass", ""),
    "sin": ("drum_eccentricity", ""),
    "cos": ("drum_eccentricity", ""),
}


def sparse_regression(search: SearchResult) -> tuple[str, ...] | None:
    """Forward regression by orthogonal least squares (S. A. Billings 2013, pysindy's FROLS) of what the machine that is
    refitted within its tolerances leaves, on a library of terms: the effect of the term that explains most, and a
    second one that explains SHARE as much; each has to pay ln n of chi^2. () for none; None without pysindy.

    Thresholded least squares (STLSQ) does worse here: in its full fit nearly parallel terms, as the input and a
    constant under a hanging load, are large with opposite signs.
    """
    if importlib.util.find_spec("pysindy") is None:
        return None
    problem = search.problem
    residual = search.within_tolerances.residual[: problem.inputs]
    columns = {name: column for name, column in _terms(problem).items() if np.ptp(column) > 0.0 or name == "1"}
    theta = np.column_stack([column / max(float(np.sqrt(np.mean(column**2))), 1e-300) for column in columns.values()])
    of_axis = kind_of(problem.machine).dead_line is None
    whole = problem.share * float(residual @ residual) / problem.noise**2
    cost = math.log(max(problem.share * problem.inputs, 2.0))
    order = _by_what_they_explain(theta, residual)
    names = list(columns)
    taken = [names[k] for k, part in order if part * whole > cost and part >= SHARE * order[0][1]]
    return tuple(sorted({_NAMES[name][of_axis] or "unlisted" for name in taken}))


def _by_what_they_explain(theta: Array, residual: Array) -> list[tuple[int, float]]:
    """The first two columns that FROLS takes, each with the part of the residual's energy that it explains."""
    from pysindy import FROLS

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns where nothing is left
        try:
            model = FROLS(max_iter=2, alpha=0.0).fit(theta, residual[:, None])
        except ValueError:  # nothing is left at all, or columns are exactly parallel
            return []
    first, both = (set(np.flatnonzero(model.history_[size][0])) for size in (1, 2))
    parts = model.ERR_global[:, 0]
    return [(int(k), float(parts[at])) for at, which in enumerate((first, both - first)) for k in which]


def _terms(problem: Problem) -> dict[str, Array]:
    """name -> (inputs,) of each term, at the rows of the input's residual."""
    bench = problem.bench
    parts: dict[str, list[Array]] = {}
    for j, (run, rows) in enumerate(zip(bench.runs, problem.rows, strict=True)):
        t = run.time_s
        v, a = (lowpass(t, x, bench.band_hz)[rows] for x in (bench.motions[j].speed, bench.motions[j].acceleration))
        u, x = bench.measured[j][rows], bench.motions[j].position[rows]
        sign, ones = np.sign(v), np.ones(len(rows))
        top = max(float(np.max(np.abs(v), initial=0.0)), 1e-300)
        turn = kind_of(problem.machine)
        height = run.start_position_m + turn.transmission_of(problem.machine) * (x - bench.motions[j].position[0])
        angle = x / float(problem.machine.gearbox.ratio) if turn.dead_line is not None else x
        cold = np.exp(-(run.start_time_s + t[rows] - t[0]) / WARM_S)
        terms = {
            "1": ones,
            "sgn v": sign,
            "v": v,
            "v |v|": v * np.abs(v),
            "a": a,
            "sgn v low": sign * np.exp(-((v / (LOW_SPEED * top)) ** 2)),
            "sgn v cold": sign * cold,
            "u": u,
            "u sgn v": u * sign,
            "du/dt": np.gradient(bench.measured[j], t)[rows],
            "payload": run.payload_kg * ones,
            "payload sgn v": run.payload_kg * sign,
            "x": height,
            "sin": np.sin(angle),
            "cos": np.cos(angle),
        }
        for name, column in terms.items():
            parts.setdefault(name, []).append(column)
    return {name: np.concatenate(columns) for name, columns in parts.items()}
