"""What a loop is set to: the `controller` block of a scenario, and what `tune` writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import Discriminator, Field, Tag, model_validator

from workbench.core.errors import InputError
from workbench.core.record import Frequency, KiGain, KpGain, RateLimit, Record, TrackingTime
from workbench.core.yaml_strict import Document, load, validate
from workbench.machines import KINDS

Fraction = Annotated[float, Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False)]


SampleTime = Annotated[float, Field(ge=1e-4, le=0.05, strict=True, allow_inf_nan=False)]


class Notch(Record):
    """Takes out a lightly damped wire: depth at its frequency is depth (0 takes all), width grows with damping."""

    frequency_hz: Frequency
    damping: Annotated[float, Field(gt=0.0, le=2.0, strict=True, allow_inf_nan=False)] = 0.5
    depth: Fraction = 0.1


def _notch_is_sampled(settings: Any) -> Any:
    """Beyond half of the sample rate the sampled notch is unstable, just below it no notch."""
    most = 0.5 / settings.sample_time_s
    if settings.notch is not None and settings.notch.frequency_hz >= most:
        raise ValueError(
            f"notch.frequency_hz: {settings.notch.frequency_hz:g} Hz, expected less than {most:g} Hz, half of the "
            "sample rate"
        )
    return settings


class FeedForward(Record):
    """Fractions of what the machine's own values say: torque of inertia, of the weight, of guide friction.

    wire: how far the inertia's torque knows the wire: at 0 carriage and payload follow the drum at once, at 1 they
    swing behind it as the machine's stiffness and damping say.
    """

    inertia: Fraction = 0.0
    weight: Fraction = 0.0
    friction: Fraction = 0.0
    wire: Fraction = 0.0

    @property
    def through_the_wire(self) -> bool:
        """Whether the load's swing is computed at all."""
        return self.inertia > 0.0 and self.wire > 0.0


class PiSettings(Record):
    """The sampled PI speed loop; gains act on motor speed and give the torque of all motors together.

    anti_windup: back_calculation runs the integral back with tracking_time_s (kp/ki when null),
    conditional stops it while the torque is limited and the error would drive it further in.
    The notch and the low-pass stand in the controller's output, before feed-forward and limits.
    """

    kind: Literal["pi"] = "pi"
    sample_time_s: SampleTime = 0.001
    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain
    set_point_weight: Fraction = 1.0
    anti_windup: Literal["back_calculation", "conditional", "none"] = "back_calculation"
    tracking_time_s: TrackingTime | None = None
    torque_rate_limit_nm_per_s: RateLimit | None = None
    low_pass_hz: Frequency | None = None
    notch: Notch | None = None
    feed_forward: FeedForward = FeedForward()

    GAINS: ClassVar[tuple[str, str]] = ("kp_nm_s_per_rad", "ki_nm_per_rad")
    UNITS: ClassVar[tuple[str, str]] = ("N m s/rad", "N m/rad")

    _sampled = model_validator(mode="after")(_notch_is_sampled)

    @property
    def kp(self) -> float:
        """N m s/rad."""
        return self.kp_nm_s_per_rad

    @property
    def ki(self) -> float:
        """N m/rad."""
        return self.ki_nm_per_rad

    @property
    def tracking_rate_per_s(self) -> float:
        """1/Tt of the back-calculation; 0 where there is none."""
        return tracking_rate(self)

    @property
    def plain(self) -> bool:
        """Whether the loop is a PI with limits and back-calculation only."""
        return (
            self.anti_windup != "conditional"
            and self.torque_rate_limit_nm_per_s is None
            and self.low_pass_hz is None
            and self.notch is None
            and self.feed_forward == FeedForward()
        )


class AxisFeedForward(Record):
    """speed: the part of the reference's speed that goes to the speed loop beside the position loop's own. The others
    are fractions of what the machine's own values say: force of its inertia, of its load, of its friction."""

    speed: Fraction = 1.0
    inertia: Fraction = 0.0
    load: Fraction = 0.0
    friction: Fraction = 0.0


class Cascade(Record):
    """A position loop over a sampled PI speed loop, both at the motor's encoder; gains give the axis' force or torque.

    kv_per_s: speed asked for per position error; 0 is a speed loop alone. set_point_weight acts on the reference's
    speed, not on the position loop's. The other keys are those of the hoist's PI.
    """

    kind: Literal["cascade"] = "cascade"
    sample_time_s: SampleTime = 0.001
    kv_per_s: Annotated[float, Field(ge=0.0, le=1e5, strict=True, allow_inf_nan=False)] = 0.0
    set_point_weight: Fraction = 1.0
    anti_windup: Literal["back_calculation", "conditional", "none"] = "back_calculation"
    tracking_time_s: TrackingTime | None = None
    low_pass_hz: Frequency | None = None
    notch: Notch | None = None
    feed_forward: AxisFeedForward = AxisFeedForward()

    GAINS: ClassVar[tuple[str, str]]
    UNITS: ClassVar[tuple[str, str]]

    _sampled = model_validator(mode="after")(_notch_is_sampled)

    @model_validator(mode="after")
    def _speed_is_asked_for(self) -> Cascade:
        if self.kv_per_s == 0.0 and self.feed_forward.speed == 0.0:
            raise ValueError("kv_per_s and feed_forward.speed are both 0: nothing asks the axis to move")
        return self

    @property
    def kp(self) -> float:
        """In the first of UNITS."""
        return float(getattr(self, self.GAINS[0]))

    @property
    def ki(self) -> float:
        """In the second of UNITS."""
        return float(getattr(self, self.GAINS[1]))

    @property
    def tracking_rate_per_s(self) -> float:
        """1/Tt of the back-calculation; 0 where there is none."""
        return tracking_rate(self)

    @property
    def rate_limit(self) -> float | None:
        """Per second; None without one."""
        raise NotImplementedError


class LinearCascade(Cascade):
    """Of a linear axis: N, m."""

    kp_n_s_per_m: KpGain
    ki_n_per_m: KiGain
    force_rate_limit_n_per_s: RateLimit | None = None

    GAINS: ClassVar[tuple[str, str]] = ("kp_n_s_per_m", "ki_n_per_m")
    UNITS: ClassVar[tuple[str, str]] = ("N s/m", "N/m")

    @property
    def rate_limit(self) -> float | None:
        """N/s."""
        return self.force_rate_limit_n_per_s


class RotaryCascade(Cascade):
    """Of a rotary axis: N m, rad."""

    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain
    torque_rate_limit_nm_per_s: RateLimit | None = None

    GAINS: ClassVar[tuple[str, str]] = PiSettings.GAINS
    UNITS: ClassVar[tuple[str, str]] = PiSettings.UNITS

    @property
    def rate_limit(self) -> float | None:
        """N m/s."""
        return self.torque_rate_limit_nm_per_s


# PiSettings, LinearCascade or RotaryCascade, as the machine's kind has it.
Settings: TypeAlias = Any
# The controller of each kind of machine.
SETTINGS: dict[str, type[PiSettings] | type[LinearCascade] | type[RotaryCascade]] = {
    kind.name: (RotaryCascade if kind.drive.suffix == "nm" else LinearCascade) if loop.position_loop else PiSettings
    for kind in KINDS.values()
    if (loop := kind.closed_loop) is not None
}


FORMS: dict[str, type[PiSettings] | type[LinearCascade] | type[RotaryCascade]] = {
    "pi": PiSettings,
    "linear": LinearCascade,
    "rotary": RotaryCascade,
}


def form_of(value: Any) -> str:
    """Which controller a block is meant to be, by its kind and its keys: pi, linear or rotary."""
    keys = set(value) if isinstance(value, dict) else set(vars(value)) if isinstance(value, Record) else set()
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    own = (set(LinearCascade.model_fields) | set(RotaryCascade.model_fields)) - set(PiSettings.model_fields)
    if kind != "cascade" and not keys & own:
        return "pi"
    return "rotary" if keys & set(RotaryCascade.GAINS) else "linear"


# A controller block of a file, whichever machine it is for.
if TYPE_CHECKING:
    AnyController: TypeAlias = Any
else:
    AnyController = Annotated[
        Annotated[PiSettings, Tag("pi")]
        | Annotated[LinearCascade, Tag("linear")]
        | Annotated[RotaryCascade, Tag("rotary")],
        Discriminator(form_of),
    ]


def read_settings(path: Path) -> Settings:
    """The `controller` block of a file, of any kind of machine: an output of tune, or a scenario."""
    document = load(path)
    block = document.data.get("controller") if isinstance(document.data, dict) else None
    if not isinstance(block, dict):
        raise InputError("holds no block 'controller'", file=path)
    inside = {place[1:]: line for place, line in document.lines.items() if place[:1] == ("controller",)}
    return validate(FORMS[form_of(block)], Document(document.file, block, inside))


def read_controller(path: Path) -> PiSettings:
    """The same of a hoist. InputError where it is an axis'."""
    settings = read_settings(path)
    if not isinstance(settings, PiSettings):
        raise InputError(f"holds an axis' controller, kind {settings.kind!r}; expected a hoist's", file=path)
    return settings


def tracking_rate(settings: Any) -> float:
    """ki/kp where no tracking time is given; 1/s."""
    if settings.anti_windup != "back_calculation":
        return 0.0
    if settings.tracking_time_s is not None:
        return 1.0 / float(settings.tracking_time_s)
    return float(settings.ki / settings.kp)


def low_pass_gain(frequency_hz: float | None, sample_time_s: float) -> float:
    """alpha of y += alpha (x - y), the exact discretisation of a first-order lag; 1 is no filter."""
    return 1.0 if frequency_hz is None else 1.0 - math.exp(-2.0 * math.pi * frequency_hz * sample_time_s)


def lag_gain(time_constant_s: float, sample_time_s: float) -> float:
    """alpha of y += alpha (x - y) for a time constant; 1 where it is zero."""
    return 1.0 if time_constant_s == 0.0 else 1.0 - math.exp(-sample_time_s / time_constant_s)


def notch_coefficients(notch: Notch | None, sample_time_s: float) -> tuple[float, float, float, float, float]:
    """b0, b1, b2, a1, a2 of the sampled notch; (1, 0, 0, 0, 0) is no notch.

    Tustin's rule, prewarped at the notch's frequency, on
    (s^2 + 2 depth damping w s + w^2)/(s^2 + 2 damping w s + w^2); gain 1 at zero frequency.
    """
    if notch is None:
        return 1.0, 0.0, 0.0, 0.0, 0.0
    t = math.tan(math.pi * notch.frequency_hz * sample_time_s)
    zero, pole = 2.0 * notch.depth * notch.damping * t, 2.0 * notch.damping * t
    a0 = 1.0 + pole + t * t
    return (
        (1.0 + zero + t * t) / a0,
        2.0 * (t * t - 1.0) / a0,
        (1.0 - zero + t * t) / a0,
        2.0 * (t * t - 1.0) / a0,
        (1.0 - pole + t * t) / a0,
    )
