"""What a loop is set to: the `controller` block of a scenario, and what `tune` writes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from pydantic import Discriminator, Field, Tag, model_validator

from workbench.core.errors import InputError
from workbench.core.record import Frequency, KiGain, KpGain, RateLimit, Record, TrackingTime
from workbench.core.yaml_strict import load, validate
from workbench.machines import KINDS

Fraction = Annotated[float, Field(ge=0.0, le=1.0, strict=True, allow_inf_nan=False)]


SampleTime = Annotated[float, Field(ge=1e-4, le=0.05, strict=True, allow_inf_nan=False)]


class Notch(Record):
    """Takes out a lightly damped wire: depth at its frequency is depth (0 takes all), width grows with damping."""

    frequency_hz: Frequency
    damping: Annotated[float, Field(gt=0.0, le=2.0, strict=True, allow_inf_nan=False)] = 0.5
    depth: Fraction = 0.1


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


class InputShaper(Record):
    """The references pass through two or three impulses half a swing apart, and take that much longer.

    kind: zv, zvd or ei, see docs/references.md. frequency_hz: of the swing, damping: its damping ratio.
    """

    kind: Literal["zv", "zvd", "ei"]
    frequency_hz: Frequency
    damping: Annotated[float, Field(ge=0.0, lt=1.0, strict=True, allow_inf_nan=False)] = 0.0


class LoadDamping(Record):
    """The speed asked for yields to the load: by time_s times what its acceleration is above the reference's.

    signal: carriage_speed, differentiated up to filter_hz; or tension of the fall at the drum, without what is slower
    than filter_hz. A drive that follows such a speed is a damper in series with the wire, of ratio time_s · ω/2.
    """

    signal: Literal["carriage_speed", "tension"]
    time_s: Annotated[float, Field(gt=0.0, le=10.0, strict=True, allow_inf_nan=False)]
    filter_hz: Frequency


class ScheduledGains(Record):
    """The gains of a hoist at one payload."""

    payload_kg: Annotated[float, Field(ge=0.0, le=1e6, strict=True, allow_inf_nan=False)]
    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain


PositionGain = Annotated[float, Field(ge=0.0, le=1e5, strict=True, allow_inf_nan=False)]


class SampledLoop(Record):
    """What the loops of all kinds have.

    anti_windup: back_calculation runs the integral back with tracking_time_s (kp/ki when null), conditional stops it
    while the input is limited and the error would drive it further in. The notch and the low-pass stand in the
    controller's output, before feed-forward and limits; the shaper before everything.
    """

    kind: str
    sample_time_s: SampleTime = 0.001
    set_point_weight: Fraction = 1.0
    anti_windup: Literal["back_calculation", "conditional", "none"] = "back_calculation"
    tracking_time_s: TrackingTime | None = None
    low_pass_hz: Frequency | None = None
    notch: Notch | None = None
    input_shaper: InputShaper | None = None

    GAINS: ClassVar[tuple[str, str]]
    UNITS: ClassVar[tuple[str, str]]
    RATE_LIMIT: ClassVar[str] = "torque_rate_limit_nm_per_s"

    @model_validator(mode="after")
    def _notch_is_sampled(self) -> Any:
        """Beyond half of the sample rate the sampled notch is unstable, just below it no notch."""
        most = 0.5 / self.sample_time_s
        if self.notch is not None and self.notch.frequency_hz >= most:
            raise ValueError(
                f"notch.frequency_hz: {self.notch.frequency_hz:g} Hz, expected less than {most:g} Hz, half of the "
                "sample rate"
            )
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
    def rate_limit(self) -> float | None:
        """Of the input, per second; None without one."""
        limit: float | None = getattr(self, self.RATE_LIMIT)
        return limit

    @property
    def tracking_rate_per_s(self) -> float:
        """1/Tt of the back-calculation, ki/kp where no tracking time is given; 0 where there is none."""
        if self.anti_windup != "back_calculation":
            return 0.0
        return 1.0 / self.tracking_time_s if self.tracking_time_s is not None else self.ki / self.kp

    def at(self, payload_kg: float | None) -> Any:
        """The settings for a payload: themselves, unless gains are scheduled."""
        return self


class PiSettings(SampledLoop):
    """The sampled loop of a hoist; gains act on motor speed and give the torque of all motors together.

    kv_per_s: of a position loop over the speed loop, speed asked for per error of the motor's angle. gain_schedule:
    kp and ki by payload, straight lines between, in place of those above where the payload is known.
    """

    kind: Literal["pi"] = "pi"
    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain
    kv_per_s: PositionGain | None = None
    torque_rate_limit_nm_per_s: RateLimit | None = None
    feed_forward: FeedForward = FeedForward()
    load_damping: LoadDamping | None = None
    gain_schedule: tuple[ScheduledGains, ...] | None = None

    GAINS: ClassVar[tuple[str, str]] = ("kp_nm_s_per_rad", "ki_nm_per_rad")
    UNITS: ClassVar[tuple[str, str]] = ("N m s/rad", "N m/rad")

    @model_validator(mode="after")
    def _payloads_rise(self) -> PiSettings:
        loads = [gains.payload_kg for gains in self.gain_schedule or ()]
        if loads != sorted(set(loads)) or (loads == [] and self.gain_schedule is not None):
            raise ValueError("gain_schedule: expected payloads that rise, at least one")
        return self

    @property
    def plain(self) -> bool:
        """Whether the loop is a PI with limits and back-calculation only."""
        beside = (self.torque_rate_limit_nm_per_s, self.low_pass_hz, self.notch, self.load_damping)
        return (
            self.anti_windup != "conditional"
            and all(term is None for term in beside)
            and not self.kv_per_s
            and self.feed_forward == FeedForward()
        )

    @property
    def parts(self) -> tuple[bool, str, str]:
        """What `full_pi` is made of: wire, position, damping."""
        damping = "" if self.load_damping is None else self.load_damping.signal
        return self.feed_forward.through_the_wire, "summed" if self.kv_per_s else "", damping

    def at(self, payload_kg: float | None) -> PiSettings:
        """The settings with the gains scheduled for a payload. InputError where it has to be known and is not."""
        if self.gain_schedule is None:
            return self
        if payload_kg is None:
            raise InputError("gains are scheduled over the payload, which is not known here", place="gain_schedule")
        loads = [gains.payload_kg for gains in self.gain_schedule]
        now = {
            name: float(np.interp(payload_kg, loads, [getattr(gains, name) for gains in self.gain_schedule]))
            for name in self.GAINS
        }
        return self.model_copy(update={**now, "gain_schedule": None})


def refuse(settings: Any, who: str, *names: str) -> None:
    """InputError where a controller has one of these terms, which `who` does not know."""
    used = [name for name in names if getattr(settings, name, None)]
    if used:
        raise InputError(f"{who} without {' and '.join(used)}; leave that out of the controller", place=used[0])


class AxisFeedForward(Record):
    """speed: the part of the reference's speed that goes to the speed loop beside the position loop's own. The others
    are fractions of what the machine's own values say: force of its inertia, of its load, of its friction."""

    speed: Fraction = 1.0
    inertia: Fraction = 0.0
    load: Fraction = 0.0
    friction: Fraction = 0.0


class Cascade(SampledLoop):
    """A position loop over a sampled PI speed loop, both at the motor's encoder; gains give the axis' force or torque.

    kv_per_s: speed asked for per position error; 0 is a speed loop alone. set_point_weight acts on the reference's
    speed, not on the position loop's.
    """

    kind: Literal["cascade"] = "cascade"
    kv_per_s: PositionGain = 0.0
    feed_forward: AxisFeedForward = AxisFeedForward()

    @model_validator(mode="after")
    def _speed_is_asked_for(self) -> Cascade:
        if self.kv_per_s == 0.0 and self.feed_forward.speed == 0.0:
            raise ValueError("kv_per_s and feed_forward.speed are both 0: nothing asks the axis to move")
        return self


class LinearCascade(Cascade):
    """Of a linear axis: N, m."""

    kp_n_s_per_m: KpGain
    ki_n_per_m: KiGain
    force_rate_limit_n_per_s: RateLimit | None = None

    GAINS: ClassVar[tuple[str, str]] = ("kp_n_s_per_m", "ki_n_per_m")
    UNITS: ClassVar[tuple[str, str]] = ("N s/m", "N/m")
    RATE_LIMIT: ClassVar[str] = "force_rate_limit_n_per_s"


class RotaryCascade(Cascade):
    """Of a rotary axis: N m, rad."""

    kp_nm_s_per_rad: KpGain
    ki_nm_per_rad: KiGain
    torque_rate_limit_nm_per_s: RateLimit | None = None

    GAINS: ClassVar[tuple[str, str]] = PiSettings.GAINS
    UNITS: ClassVar[tuple[str, str]] = PiSettings.UNITS


# PiSettings, LinearCascade or RotaryCascade, as the machine's kind has it.
Settings: TypeAlias = Any
# The controller of each kind of machine.
SETTINGS: dict[str, type[PiSettings | LinearCascade | RotaryCascade]] = {
    kind.name: (RotaryCascade if kind.drive.suffix == "nm" else LinearCascade) if loop.position_loop else PiSettings
    for kind in KINDS.values()
    if (loop := kind.closed_loop) is not None
}


FORMS: dict[str, type[PiSettings | LinearCascade | RotaryCascade]] = {
    "pi": PiSettings,
    "linear": LinearCascade,
    "rotary": RotaryCascade,
}


def form_of(value: Any) -> str:
    """Which controller a block is meant to be, by its kind and its keys: pi, linear or rotary."""
    keys = set(value) if isinstance(value, dict) else set(vars(value)) if isinstance(value, Record) else set()
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    own = (set(LinearCascade.model_fields) | set(RotaryCascade.model_fields)) - set(PiSettings.model_fields)
    own |= {"kv_per_s"} if kind is None else set()  # a hoist's says kind: pi
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
    block = load(path).block("controller")
    if block is None:
        raise InputError("holds no block 'controller'", file=path)
    return validate(FORMS[form_of(block.data)], block)


def read_controller(path: Path) -> PiSettings:
    """The same of a hoist. InputError where it is an axis'."""
    settings = read_settings(path)
    if not isinstance(settings, PiSettings):
        raise InputError(f"holds an axis' controller, kind {settings.kind!r}; expected a hoist's", file=path)
    return settings


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
