"""What a diagnosis says: one frozen record for each step, and one that holds them all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Literal

from workbench.logs import Campaign
from workbench.machine import Axis, Hoist
from workbench.run import Array
from workbench.shown import Shown

if TYPE_CHECKING:
    from workbench.consequences import Consequences
    from workbench.diagnose.hypotheses.search import Found
    from workbench.diagnose.verdict.judge import Judged

Names = tuple[str, ...]
VerdictWord = Literal["named", "no_gap", "unknown"]


class ReasonKind(Enum):
    """What speaks against the best named hypothesis."""

    UNLISTED_EXPLAINS_MORE = "unlisted_explains_more"
    LEAVES_MUCH = "leaves_much"
    STRETCHES_TOLERANCES = "stretches_tolerances"
    ON_A_BOUND = "on_a_bound"
    UNDO_EACH_OTHER = "undo_each_other"


@dataclass(frozen=True)
class Reason:
    """value: N m (N) left, or standard deviations; percent: of the input's rms; effects: those it is about."""

    kind: ReasonKind
    effects: Names = ()
    value: float = 0.0
    percent: float = 0.0


@dataclass(frozen=True)
class Left:
    """What the answer leaves beyond noise and discrepancy: rms, N m (N); per cent of the input's rms; whether that
    changes a conclusion of a study."""

    rms: float
    percent_of_input: float
    relevant: bool


@dataclass(frozen=True)
class RunCondition:
    """How fit one run's log is. noise_rms: of the input in the band, N m (N). moving_share: of its samples that
    speak of friction and inertia. delay_s: logged speed behind its reference, None without one."""

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
    """The logs, made ready. sentences: what was repaired, left out or is worth a warning."""

    runs: tuple[RunCondition, ...]
    band_hz: float
    noise_rms: float
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Gap:
    """How large the gap is after the base parameters were refitted within their tolerances.

    residual_rms, noise_rms: input, N m (N), below band_hz. force_rms_n: the same as a force on the carriage (None on
    an axis). speed_rmse_percent: open-loop replay of the refitted machine. nominal_*: before any refit.
    """

    residual_rms: float
    noise_rms: float
    band_hz: float
    force_rms_n: float | None
    speed_rmse_percent: float
    nominal_residual_rms: float
    nominal_speed_rmse_percent: float
    worst_tolerance: tuple[str, float]
    significant: bool
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class Window:
    run: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class Profile:
    """The gap over one variable: in each bin its mean and rms, N m (N), and its share of the energy.

    edges: (k + 1,); mean_forward, mean_backward, share: (k,), NaN where nothing lies; over frequency there is no mean,
    and share is what the best single wave of a bin takes of the energy. explains: share of the gap's energy that a
    function of this variable (and direction) takes away; interval: of it, 90 %, over runs.
    """

    variable: str
    label: str
    unit: str
    regime: str
    edges: Array
    mean_forward: Array
    mean_backward: Array
    share: Array
    explains: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class PlaceProbability:
    """How likely the cause lies in a part of the machine, 0 to 1."""

    subsystem: str
    probability: float


@dataclass(frozen=True)
class Event:
    """A brief stretch of one run, s on its own clock, that a force of one part of the machine accounts for.

    energy: its share of the gap's. largest: the force's largest value, as input, N m (N)."""

    run: str
    from_s: float
    to_s: float
    subsystem: str
    energy: float
    largest: float


@dataclass(frozen=True)
class Where:
    """Where the gap lies. share: of its energy in the windows and the regime. side: drive, carriage, or unsaid.

    places: the likeliest first, probabilities that sum to one. events: the brief stretches, where that is what it is.
    """

    subsystem: str
    regime: str
    windows: tuple[Window, ...]
    share: float
    interval: tuple[float, float]
    profiles: tuple[Profile, ...]
    energy_by_run: Mapping[str, float]
    side: str
    sentences: tuple[str, ...]
    places: tuple[PlaceProbability, ...] = ()
    events: tuple[Event, ...] = ()


@dataclass(frozen=True)
class Estimate:
    """One parameter of an effect, in the unit of its name. value: of each run where it is each run's own."""

    name: str
    value: float | tuple[float, ...]
    std_error: float | tuple[float, ...]


@dataclass(frozen=True)
class Candidate:
    """One hypothesis weighed. gain: by how much it lowers chi^2 and tolerances together; merit: less what it costs.

    residual_rms, held_out_rms: N m (N); held_out_rms is None for what was not fitted. explained: share of the gap's
    energy. against: what speaks against it. failure: why its fit broke down, "" for one that did not.
    """

    effects: Names
    gain: float
    merit: float
    residual_rms: float | None
    held_out_rms: float | None
    explained: float | None
    parameters: Mapping[str, tuple[Estimate, ...]]
    fitted: bool
    against: tuple[str, ...] = ()
    failure: str = ""


@dataclass(frozen=True)
class Hypothesis:
    """One row of the ranking."""

    verdict: VerdictWord
    effects: Names
    probability: float


@dataclass(frozen=True)
class Verdict:
    """The answer. alike: what this campaign cannot tell from it. sentence: the answer in one sentence."""

    word: VerdictWord
    effects: Names
    ranking: tuple[Hypothesis, ...]
    alike: Names
    sentence: str
    reasons: tuple[Reason, ...] = ()
    explained: float = 0.0
    left: Left = Left(0.0, 0.0, False)


@dataclass(frozen=True)
class Isolability:
    """Angles between signatures, degrees, after the base parameters are projected out. names: (k,), angle: (k, k).

    visible: (k,) the effect's smallest amount this campaign would show, in its first parameter's unit.
    """

    names: Names
    angle: Array
    visible: Mapping[str, tuple[str, float]]
    sentences: tuple[str, ...]


@dataclass(frozen=True)
class NextRun:
    """The run that would decide what is open. separation: distance of the candidates' predictions on it, in
    standard deviations, against `now` on the campaign as it is."""

    why: str
    payload_kg: float
    profile: str
    signals: tuple[str, ...]
    separation: float
    now: float


@dataclass(frozen=True)
class Shrink:
    """How far the gap shrinks on runs that were held out. before, after, noise: rms, `unit`, below band_hz.

    by_run: name -> (before, after). ci95: of the factor, a bootstrap over runs. speed_*: open-loop replay.
    """

    before: float
    after: float
    noise: float
    unit: str
    band_hz: float
    factor: float
    ci95: tuple[float, float]
    speed_rmse_percent_before: float
    speed_rmse_percent_after: float
    by_run: Mapping[str, tuple[float, float]]
    sentences: tuple[str, ...] = ()


@dataclass(frozen=True)
class Curve:
    """An unknown cause's force over what explains it best: the residual at the place it acts on, by direction."""

    over: str
    acts_on: str
    at: Array
    forward: Array
    backward: Array
    std_forward: Array
    std_backward: Array
    explains: float


@dataclass(frozen=True)
class Unknown:
    """What is known of an unknown cause. curves: best first; the first one is in the corrected machine."""

    curves: tuple[Curve, ...]
    sentences: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """Everything one diagnosis found, in the order of its steps. corrected: machine.yaml for replay and study."""

    campaign: Campaign
    seed: int
    condition: Condition
    gap: Gap
    where: Where | None
    candidates: tuple[Candidate, ...]
    isolability: Isolability
    verdict: Verdict
    next_run: NextRun | None
    shrink: Shrink
    corrected: Hoist | Axis
    refitted: Hoist | Axis
    unknown: Unknown | None
    consequences: Consequences | None
    why_no_consequences: str
    found: Found = field(repr=False, compare=False)
    judged: Judged = field(repr=False, compare=False)
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """The answer in a few lines; `table()` and `plot()` show the rest."""
        likeliest = sorted(self.verdict.ranking, key=lambda row: -row.probability)[:3]
        shrink = self.shrink
        lines = [
            f"Diagnosis of {self.campaign.name}",
            f"  {self.verdict.sentence}",
            *(f"  {row.probability:.2f} {' + '.join(row.effects) or row.verdict}" for row in likeliest),
            f"  held-out residual: {shrink.before:.3g} to {shrink.after:.3g} {shrink.unit}, noise {shrink.noise:.3g}",
        ]
        if self.where is not None:
            lines.append(f"  where: {self.where.subsystem}, {self.where.regime}")
        return "\n".join(lines)
