"""The condition of the logs: the quality of each run, and warnings about its figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.core.numbers import figures
from workbench.core.run import Array, Run
from workbench.diagnose.hypotheses.problem import Problem
from workbench.diagnose.readiness.checks import FAR, listed, reference_of, reference_slope
from workbench.logs import Campaign
from workbench.logs.raw_run import is_constant
from workbench.logs.samples import clipped
from workbench.machines import kind_of


@dataclass(frozen=True)
class RunCondition:
    """The condition of one run's log. noise_rms: of the input in the band, N m (N). moving_share: share of the
    samples in motion. delay_s: logged speed behind its reference, None without one."""

    name: str
    samples: int
    sample_time_s: float
    noise_rms: float
    moving_share: float
    clipped_share: float
    outliers: int
    delay_s: float | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Condition:
    """The condition of all logs. sentences: repairs, omissions and warnings."""

    runs: tuple[RunCondition, ...]
    band_hz: float
    noise_rms: float
    sentences: tuple[str, ...]


LONGEST_S = 2.0  # a signal that is later than that follows something else
REFINEMENTS = 20
LARGEST_CHANGE_S = 0.02  # of one refinement: noise may put the correlation's peak some samples off


def lateness(time_s: Array, reference: Array, signal: Array) -> float | None:
    """The delay in s of `signal`, (n,), behind `reference`, (n,); None if neither moves.

    Cross-correlation finds it to a sample; then the shift d is refined that leaves the least of
    signal − gain·reference(t − d) − offset, by Gauss-Newton. Negative where the signal leads.
    """
    step = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1] + 0.5 * step, step)
    r, s = (np.interp(even, time_s, values) for values in (reference, signal))
    r, s = r - r.mean(), s - s.mean()
    if not (r.any() and s.any()):
        return None
    n = len(even)
    most = min(int(LONGEST_S / step), n // 4)
    if most < 2:
        return None
    size = 1 << (2 * n - 1).bit_length()
    product = np.fft.irfft(np.fft.rfft(s, size) * np.conj(np.fft.rfft(r, size)), size)
    lags = np.arange(-most, most + 1)
    shift = float(lags[int(np.argmax(product[lags]))]) * step
    # Away from the ends every shifted sample has its reference.
    rows = slice(most, n - most)
    for _ in range(REFINEMENTS):
        at = even[rows] - shift
        moved = np.interp(at, even, r)
        slope = np.interp(at, even, np.gradient(r, step))
        x = np.stack([moved, np.ones_like(moved), -slope], axis=1)
        coefficients, *_ = np.linalg.lstsq(x, s[rows], rcond=1e-10)
        if abs(coefficients[0]) < 1e-9:
            return None
        change = float(coefficients[2] / coefficients[0])
        shift += float(np.clip(change, -LARGEST_CHANGE_S, LARGEST_CHANGE_S))
        if abs(change) < 1e-3 * step:
            break
    return shift if abs(shift) < LONGEST_S else None


SPIKE = 10.0  # of the channel's noise: a single sample that far off both its neighbours
CLIPPED = 0.002  # share of the samples worth a sentence
NOISE_APART = 3.0  # times the others' noise


def condition(campaign: Campaign, problem: Problem, motion_noise_rms: float = 0.0) -> Condition:
    """motion_noise_rms: the noise of the prediction that comes from the motion, see `with_motion_noise`."""
    runs = tuple(_run(problem, j) for j in range(len(problem.runs)))
    own = problem.input_noise
    sentences = (*campaign.all_notes, *_sentences(problem, runs, own, motion_noise_rms))
    return Condition(runs, problem.band_hz, float(np.hypot(own, motion_noise_rms)), sentences)


def _run(problem: Problem, j: int) -> RunCondition:
    run, bench = problem.logged[j], problem.bench
    names = _inputs(problem, run)
    motion = bench.plant.speeds[0] if bench.plant.speeds[0] in run else bench.plant.positions[0]
    return RunCondition(
        run.name,
        len(run.time_s),
        run.sample_time_s,
        float(bench.noise[j]),
        float(np.mean(bench.moving[j])),
        max(clipped_share(run.time_s, run[name]) for name in names),
        sum(outliers(run[name]) for name in (bench.plant.input, motion)),
        _delay(problem, j),
        run.notes,
    )


def _inputs(problem: Problem, run: Run) -> tuple[str, ...]:
    """Each motor separately if both are logged, because a sum hides the clipping of one."""
    return tuple(name for name in kind_of(problem.machine).inputs if name in run)


def clipped_share(time_s: Array, values: Array) -> float:
    """The share of samples that stay at the largest or smallest value, as in a clipped signal."""
    # Clipped alike both ways, a signal rests as long at the one end as at the other: only its size tells.
    if clipped(time_s, values) is None and clipped(time_s, np.abs(values)) is None:
        return 0.0
    # Only extremes that are held count: a largest value of its own is in every signal.
    at = (values == values.max()) | (values == values.min())
    held = at & (np.concatenate([[False], at[:-1]]) | np.concatenate([at[1:], [False]]))
    return float(np.mean(held))


def outliers(values: Array) -> int:
    """Single samples that differ from both neighbours in the same direction, far beyond noise and curvature."""
    if len(values) < 5 or is_constant(values):
        return 0
    steps = np.diff(values)
    before, after = steps[:-1], -steps[1:]
    stands = np.where(before * after > 0.0, np.minimum(np.abs(before), np.abs(after)), 0.0)
    sigma = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / np.sqrt(6.0)
    resolution = np.abs(steps[steps != 0.0])
    least = max(SPIKE * sigma, 5.0 * float(resolution.min()))
    # Where the signal itself swings from sample to sample, what it does in general is no outlier.
    typical = 4.0 * float(np.percentile(stands, 99.0))
    return int(np.count_nonzero(stands > max(least, typical)))


def _delay(problem: Problem, j: int) -> float | None:
    """The delay in s; None without a reference, or if the motion does not follow it."""
    run = problem.logged[j]
    both, slope = reference_of(problem.machine, run), reference_slope(problem.bench, j)
    if both is None or slope is None or not 1.0 / FAR < slope < FAR:
        return None
    return lateness(run.time_s, *both)


def _sentences(problem: Problem, runs: Sequence[RunCondition], own: float, motion_noise_rms: float) -> list[str]:
    unit = kind_of(problem.machine).drive.unit
    sentences = []
    cut = [r for r in runs if r.clipped_share > CLIPPED]
    if cut:
        sentences.append(
            f"{problem.bench.plant.input} looks clipped in {listed([r.name for r in cut])}, at most "
            f"{100.0 * max(r.clipped_share for r in cut):.1f} % of the samples; what lies above is not in the log."
        )
    spikes = [r for r in runs if r.outliers]
    if spikes:
        total = sum(r.outliers for r in spikes)
        sentences.append(
            f"{total} single sample{'s' if total > 1 else ''} far off {'their' if total > 1 else 'its'} neighbours in "
            f"{listed([r.name for r in spikes])}; the low-pass spreads them, nothing was taken out."
        )
    typical = float(np.median([r.noise_rms for r in runs]))
    loud = [r for r in runs if r.noise_rms > NOISE_APART * typical]
    if loud:
        sentences.append(f"{listed([r.name for r in loud])}: noise of more than {NOISE_APART:g} times the other runs'.")
    delays = {r.name: r.delay_s for r in runs if r.delay_s is not None}
    low, high = min(delays.values(), default=0.0), max(delays.values(), default=0.0)
    if round(1e3 * low) or round(1e3 * high):
        late = "the control loop's lag and any delay of the sensor"
        early = "a log has its motion behind its reference; check the clocks of the two"
        why = "; ".join(text for text, so in ((late, round(1e3 * high) > 0), (early, round(1e3 * low) < 0)) if so)
        sentences.append(f"The motion follows its reference {_span(low, high)}: {why}.")
    if motion_noise_rms > 0.5 * own:
        sentences.append(
            f"The measured motion's own noise adds {figures(motion_noise_rms, 2)} {unit} to the prediction, the "
            f"input's is {figures(own, 2)} {unit}."
        )
    return sentences


def _span(low: float, high: float) -> str:
    """20 ms late; 20 to 30 ms early; from 20 ms early to 30 ms late."""
    a, b = round(1e3 * low), round(1e3 * high)
    if a < 0 < b:
        return f"from {-a} ms early to {b} ms late"
    near, far = sorted((abs(a), abs(b)))
    return f"{near if near == far else f'{near} to {far}'} ms {'early' if a < 0 else 'late'}"
