"""Problems of a diagnosis made of simulated runs, and fits to them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.noisy_runs import hoist_runs, with_effects
from workbench.core.run import Array
from workbench.diagnose.hypotheses.fit import Fitted, fit_hypothesis
from workbench.diagnose.hypotheses.free_parameters import GAIN, OFFSET, Setting, base_parameters, effect_parameters
from workbench.diagnose.hypotheses.problem import Problem
from workbench.effects import find, ranges_of
from workbench.machines import default_hoist, kind_of


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def made_by(problem: Problem, setting: Setting) -> Problem:
    """The problem with the torque that the machine under `setting` takes, to the last bit of it."""
    nominal = kind_of(problem.machine).sensor_of(problem.machine)
    gain, offset = (float(np.mean(setting.get(key, x))) for key, x in zip((GAIN, OFFSET), nominal, strict=True))
    predicted = [required[:, 0, 0] for required in problem.bench.required(problem.tables([setting]))]
    runs = [
        replace(run, signals={**run.signals, "torque_motor_nm": gain * raw + offset})
        for run, raw in zip(problem.runs, predicted, strict=True)
    ]
    return Problem(problem.machine, runs, problem.band_hz).exact()


def fitted_to(
    truth: dict[str, dict[str, float]], begin: dict[str, float | tuple[float, ...]]
) -> tuple[Problem, Fitted]:
    problem = Problem(default_hoist(), hoist_runs(with_effects(default_hoist(), truth), seed=4))
    (name,) = truth
    effect = find(name, "hoist")
    ranges = ranges_of(effect, problem.machine, problem.runs)
    more, start = effect_parameters(effect, ranges, {r.symbol: begin[r.name] for r in ranges})
    free = [*base_parameters(problem.machine, problem.runs).values(), *more]
    z = np.concatenate([np.zeros(len(free) - len(more)), start])
    return problem, fit_hypothesis(problem, (name,), free, z, 60)
