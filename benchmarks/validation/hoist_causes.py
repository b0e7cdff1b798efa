"""What can ail a hoist: the effects of the campaign format, each with its size drawn, and causes that no list holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.validation.kind import TURN, Cause, Numbers, about, drawn_event, either
from workbench.machines import Hoist


@dataclass(frozen=True)
class Scales:
    """What is large on one machine. force, N: weight of the empty carriage. torque, N m: of all motors,
    nominal. low_m, high_m: the heights that most runs pass. payload_kg: the
    full one. The rest as in machine.yaml."""

    force: float
    speed: float
    motor_speed: float
    torque: float
    radius: float
    line_kg_per_m: float
    inertia: float
    low_m: float
    high_m: float
    levels: tuple[float, float]
    payload_kg: float

    def heights(self, margin_m: float) -> tuple[float, float]:
        """The lowest and highest place of an effect that most runs pass: a margin inside, less where they are short."""
        margin = min(margin_m, 0.25 * (self.high_m - self.low_m))
        return self.low_m + margin, self.high_m - margin


def scales_of(m: Hoist, payload_kg: float, low_m: float, high_m: float) -> Scales:
    return Scales(
        force=m.carriage.mass_kg * m.gravity_m_s2,
        speed=m.motor.nominal_speed_rad_s * m.lift_m_per_rad,
        motor_speed=m.motor.nominal_speed_rad_s,
        torque=m.motor.count * m.motor.nominal_torque_nm,
        radius=m.winch.drum_diameter_m / 2.0,
        line_kg_per_m=m.carriage.mass_kg / m.wire.segment_length_m,
        inertia=m.motor.count * m.motor.rotor_inertia_kg_m2 + m.winch.inertia_kg_m2 / m.gearbox.ratio**2,
        low_m=low_m,
        high_m=high_m,
        levels=(m.guide.coulomb_hoisting_n, m.guide.coulomb_lowering_n),
        payload_kg=payload_kg,
    )


Draw = Callable[[np.random.Generator, Scales], Cause]
_LEVEL_LIKE = ("torque_offset", "carriage_mass_error", "friction_coulomb_asymmetric")


def _listed(
    name: str, subsystem: str, regime: str, library: Numbers, truth: Numbers | None = None,
    values: Numbers | None = None, **more: Any,
) -> Cause:  # fmt: skip
    """A cause of the library. values: the label's, those of the truth where they are not given."""
    values = (truth or {}) if values is None else values
    return Cause(name, subsystem, regime, values, truth or {}, library={name: library}, **more)


def _viscous(rng: np.random.Generator, s: Scales) -> Cause:
    B = s.force / s.speed * about(rng, 0.015, 0.075)
    known, truth = {"viscous_n_s_per_m": B}, {"B_up": B, "B_dn": B}
    return _listed("friction_viscous", "guide", "speed", known, truth, {"B_visc": B})


def _viscous_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large = s.force / s.speed * about(rng, 0.025, 0.10)
    small = large * rng.uniform(0.0, 0.45)
    up, dn = (large, small) if rng.random() < 0.5 else (small, large)
    known = {"viscous_hoisting_n_s_per_m": up, "viscous_lowering_n_s_per_m": dn}
    return _listed("friction_viscous_asymmetric", "guide", "speed", known, {"B_up": up, "B_dn": dn})


def _coulomb(rng: np.random.Generator, s: Scales) -> Cause:
    F = s.force * about(rng, 0.045, 0.13)
    if rng.random() < 0.25:  # less friction than the engineer believes
        F = -rng.uniform(0.55, 0.85) * min(s.levels)
    return _listed("friction_coulomb", "guide", "all", {"level_n": F}, {"dF_up": F, "dF_dn": F}, {"dF": F})


def _coulomb_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large = s.force * about(rng, 0.05, 0.13)
    small = large * rng.uniform(-0.1, 0.3)
    up, dn = (large, small) if rng.random() < 0.5 else (small, large)
    known, truth = {"level_hoisting_n": up, "level_lowering_n": dn}, {"dF_up": up, "dF_dn": dn}
    return _listed("friction_coulomb_asymmetric", "guide", "all", known, truth, alike=_LEVEL_LIKE)


def _stribeck(rng: np.random.Generator, s: Scales) -> Cause:
    up, dn = s.force * about(rng, 0.03, 0.12), s.force * about(rng, 0.03, 0.12)
    v = s.speed * about(rng, 0.03, 0.11)
    known = {"peak_hoisting_n": up, "peak_lowering_n": dn, "stribeck_speed_m_s": v}
    return _listed("friction_stribeck", "guide", "low_speed", known, {"Fs_up": up, "Fs_dn": dn, "v_str": v})


def _load(rng: np.random.Generator, s: Scales) -> Cause:
    a = about(rng, 0.03, 0.14)
    return _listed("friction_load_dependent", "guide", "load", {"friction_fraction": a}, {"a_load": a})


def _bump(rng: np.random.Generator, s: Scales) -> Cause:
    A, w = s.force * about(rng, 0.028, 0.12), about(rng, 0.25, 0.8)
    x = rng.uniform(*s.heights(0.3))
    known, truth = {"peak_n": A, "centre_m": x, "width_m": w}, {"bump_A": A, "bump_x": x, "bump_w": w}
    return _listed("friction_position_dependent", "guide", "position", known, truth)


def _drift(rng: np.random.Generator, s: Scales) -> Cause:
    a, tau = about(rng, 0.4, 1.6), about(rng, 120.0, 450.0)
    known, truth = {"friction_fraction": a, "time_constant_s": tau}, {"drift_a": a, "drift_tau": tau}
    return _listed("friction_thermal_drift", "guide", "time", known, truth)


def _gear_loss(rng: np.random.Generator, s: Scales) -> Cause:
    eta = about(rng, 0.017, 0.075)
    return _listed("gearbox_efficiency", "gearbox", "load", {"loss_fraction": eta}, {"eta_loss": eta})


def _gear_inertia(rng: np.random.Generator, s: Scales) -> Cause:
    Jg = s.inertia * about(rng, 0.09, 0.4)
    return _listed("gearbox_inertia", "gearbox", "acceleration", {"inertia_kg_m2": Jg}, {"Jg": Jg})


def _brake(rng: np.random.Generator, s: Scales) -> Cause:
    T, tau = s.torque * about(rng, 0.035, 0.15), about(rng, 0.4, 1.8)
    known = {"torque_nm": T, "time_constant_s": tau}
    return _listed("brake_drag", "brake", "start", known, {"brk_T": T, "brk_tau": tau})


def _layer(rng: np.random.Generator, s: Scales) -> Cause:
    dR = s.radius * about(rng, 0.014, 0.065)
    th = 2.0 * rng.uniform(*s.heights(0.5)) / s.radius
    known = {"radius_step_m": dR, "drum_angle_rad": th}
    return _listed("drum_layer_change", "drum", "position", known, {"layer_dR": dR, "layer_th": th})


def _eccentricity(rng: np.random.Generator, s: Scales) -> Cause:
    e, ph = s.radius * about(rng, 0.004, 0.035), rng.uniform(0.0, TURN)
    known = {"amplitude_m": e, "phase_rad": ph}
    return _listed("drum_eccentricity", "drum", "periodic", known, {"ecc_e": e, "ecc_ph": ph})


def _wire(rng: np.random.Generator, s: Scales) -> Cause:
    extra = s.line_kg_per_m * about(rng, 0.01, 0.04)
    known, truth = {"mass_kg_per_m": extra}, {"rho_extra": extra}
    return _listed("wire_mass", "wire", "position", known, truth, {"wire_extra": extra})


def _stiffness_length(rng: np.random.Generator, s: Scales) -> Cause:
    return _listed("wire_stiffness_length", "wire", "position", {"share": 1.0}, {"k_share": 1.0})


def _heave(rng: np.random.Generator, s: Scales) -> Cause:
    A, w = about(rng, 0.08, 0.4), rng.uniform(0.45, 1.1)
    known, truth = {"amplitude_m": A, "frequency_rad_s": w}, {"heave_A": A, "heave_w": w}
    return _listed("heave", "platform", "time", known, truth, per_run={"heave_ph": (0.0, TURN)})


def _carriage_mass(rng: np.random.Generator, s: Scales) -> Cause:
    m = s.force / 9.81 * either(rng, 0.03, 0.11)
    known, truth = {"mass_kg": m}, {"dm_c": m}
    return _listed("carriage_mass_error", "payload", "all", known, truth, {"m_c": m}, alike=_LEVEL_LIKE)


def _payload_mass(rng: np.random.Generator, s: Scales) -> Cause:
    scale = 1.0 + either(rng, 0.025, 0.11)
    return _listed("payload_mass_error", "payload", "load", {"payload_scale": scale}, {"mp_scale": scale})


def _sensor(
    name: str, regime: str, known: str, logged: str, value: str, draw: Callable[[np.random.Generator, Scales], float],
    subsystem: str = "torque_sensor", alike: tuple[str, ...] = (),
) -> Draw:  # fmt: skip
    """One number of a sensor: as the library calls it, the log's sensor and the label."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        x = draw(rng, s)
        return _listed(name, subsystem, regime, {known: x}, values={value: x}, log={logged: x}, alike=alike)

    return drawn


def _ripple(rng: np.random.Generator, s: Scales) -> Cause:
    A, n, ph = s.torque * about(rng, 0.009, 0.04), float(rng.choice([1.0, 1.0, 2.0])), rng.uniform(0.0, TURN)
    known = {"amplitude_nm": A, "order_per_turn": n, "phase_rad": ph}
    return _listed("torque_ripple", "motor", "periodic", known, {"ripple_A": A, "ripple_n": n, "ripple_ph": ph})


def _backlash(rng: np.random.Generator, s: Scales) -> Cause:
    play = about(rng, 0.005, 0.04)
    return _listed("backlash", "gearbox", "event", {"play_rad": play}, {"play": play})


LISTED: Mapping[str, Draw] = {
    "friction_viscous": _viscous,
    "friction_viscous_asymmetric": _viscous_asymmetric,
    "friction_coulomb": _coulomb,
    "friction_coulomb_asymmetric": _coulomb_asymmetric,
    "friction_stribeck": _stribeck,
    "friction_load_dependent": _load,
    "friction_position_dependent": _bump,
    "friction_thermal_drift": _drift,
    "gearbox_efficiency": _gear_loss,
    "gearbox_inertia": _gear_inertia,
    "brake_drag": _brake,
    "drum_layer_change": _layer,
    "drum_eccentricity": _eccentricity,
    "wire_mass": _wire,
    "wire_stiffness_length": _stiffness_length,
    "heave": _heave,
    "carriage_mass_error": _carriage_mass,
    "payload_mass_error": _payload_mass,
    "torque_scale": _sensor("torque_scale", "all", "gain", "gain", "t_gain",
                            lambda rng, s: 1.0 + either(rng, 0.03, 0.13)),
    "torque_offset": _sensor("torque_offset", "all", "offset_nm", "offset", "t_off",
                             lambda rng, s: s.torque * either(rng, 0.02, 0.08), alike=_LEVEL_LIKE),
    "torque_filter": _sensor("torque_filter", "acceleration", "time_constant_s", "filter_s", "t_tau",
                             lambda rng, s: about(rng, 0.08, 0.4)),
    "speed_delay": _sensor("speed_delay", "acceleration", "delay_s", "delay_s", "w_delay",
                           lambda rng, s: about(rng, 0.05, 0.3), "speed_sensor"),
    "torque_ripple": _ripple,
    "backlash": _backlash,
}  # fmt: skip
NEARLY_INVISIBLE = ("backlash", "wire_stiffness_length")  # on a hoist whose wire is taut
USUAL = tuple(name for name in LISTED if name not in NEARLY_INVISIBLE)

# Of two effects at once: these are alike by nature, so no log says which of them it holds.
ALIKE = (
    {"torque_offset", "carriage_mass_error", "friction_coulomb_asymmetric", "friction_coulomb"},
    {"torque_scale", "carriage_mass_error", "payload_mass_error"},
    {"gearbox_efficiency", "friction_load_dependent", "friction_coulomb"},
    {"torque_filter", "speed_delay", "gearbox_inertia"},
)


def drawn_pair(rng: np.random.Generator, first: str | None = None) -> tuple[str, str]:
    """Two usual effects of different subsystems that are not alike by nature."""
    while True:
        a, b = first or str(rng.choice(USUAL)), str(rng.choice(USUAL))
        if a != b and _subsystem(a) != _subsystem(b) and not any({a, b} <= group for group in ALIKE):
            return a, b


def _subsystem(name: str) -> str:
    one = Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 9.0, (1.0, 1.0), 1.0)
    return LISTED[name](np.random.default_rng(0), one).subsystem


def _unlisted(text: str, subsystem: str, regime: str, truth: Numbers, values: Numbers | None = None,
              library: Mapping[str, Numbers] | None = None, **more: Any) -> Cause:  # fmt: skip
    """A cause of no list. values: the label's, those of the truth where they are not given."""
    values, name = truth if values is None else values, f"unlisted: {text}"
    return Cause(name, subsystem, regime, values, truth, library=library or {}, **more)


def _fan(rng: np.random.Generator, s: Scales) -> Cause:
    q = s.torque * about(rng, 0.02, 0.09) / s.motor_speed**2
    text, known = "drag on the motor that grows with the square of its speed", {"motor_fan": {"drag_nm_s2": q}}
    return _unlisted(text, "motor", "speed", {"fan_q": q}, library=known)


def _rail_step(rng: np.random.Generator, s: Scales) -> Cause:
    A, x = s.force * about(rng, 0.02, 0.08), rng.uniform(*s.heights(0.8))
    text, known = "the rail changes its friction at one height", {"friction_step": {"level_n": A, "position_m": x}}
    return _unlisted(text, "guide", "position", {"step_A": A, "step_x": x}, library=known)


def _quadratic(rng: np.random.Generator, s: Scales) -> Cause:
    c = s.force / s.speed**2 * about(rng, 0.02, 0.09)
    text, known = "drag on the carriage that grows with the square of its speed", {"drag_n_s2_per_m2": c}
    return _unlisted(text, "guide", "speed", {"drag_c": c}, library={"friction_quadratic": known})


def _roller(rng: np.random.Generator, s: Scales) -> Cause:
    A, d, ph = s.force * about(rng, 0.03, 0.10), about(rng, 0.35, 1.4), rng.uniform(0.0, TURN)
    truth, known = {"roller_A": A, "roller_d": d, "roller_ph": ph}, {"amplitude_n": A, "period_m": d, "phase_rad": ph}
    text = "friction that comes and goes over the height with a roller's turning"
    return _unlisted(text, "guide", "periodic", truth, library={"friction_periodic": known})


def _of_the_log(text: str, regime: str, value: str, logged: str, draw: Callable[[np.random.Generator, Scales], float]
                ) -> Draw:  # fmt: skip
    """One number of the torque sensor: as the label has it, and the log's sensor."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        x = draw(rng, s)
        return _unlisted(text, "torque_sensor", regime, {}, {value: x}, log={logged: x})

    return drawn


def _foreign_body(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"body_F": s.force * about(rng, 0.025, 0.09), "body_tau": about(rng, 0.3, 8.0)}
    text = "friction that sets in at some moment of each run, as of a foreign body"
    return _unlisted(text, "guide", "time", truth, per_run={"body_t": (5.0, 25.0)})


def _swinging_load(rng: np.random.Generator, s: Scales) -> Cause:
    """A share of the payload on a soft spring."""
    share, f, zeta = rng.uniform(0.5, 0.95), rng.uniform(0.35, 1.0), rng.uniform(0.01, 0.06)
    m, w = share * s.payload_kg, TURN * f  # the full payload swings with f, a lesser one faster
    truth = {"hook_share": share, "hook_k": m * w * w, "hook_c": 2.0 * zeta * w * m}
    values = {"hook_share": share, "hook_hz": f, "hook_zeta": zeta}
    return _unlisted("the payload hangs on a soft spring", "payload", "acceleration", truth, values)


def _swell(rng: np.random.Generator, s: Scales) -> Cause:
    A, w, more = about(rng, 0.08, 0.3), rng.uniform(0.45, 0.9), rng.uniform(1.25, 1.6)
    truth = {"heave_A": A, "heave_w": w, "swell_A": A / more, "swell_w": w * more}
    phases = {"heave_ph": (0.0, TURN), "swell_ph": (0.0, TURN)}
    return _unlisted("the platform moves in a swell of two frequencies", "platform", "time", truth, per_run=phases)


def _tooth(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"tooth_T": s.torque * about(rng, 0.03, 0.12), "tooth_w": rng.uniform(0.2, 0.5)}
    truth["tooth_ph"] = rng.uniform(0.0, TURN)
    return _unlisted("a damaged tooth of the gear's last wheel drags once a turn", "gearbox", "periodic", truth)


def _dent(rng: np.random.Generator, s: Scales) -> Cause:
    """The arm is longer there: more torque at one angle, in proportion to what hangs, both ways alike."""
    th = 2.0 * rng.uniform(*s.heights(0.6)) / s.radius
    truth = {"dent_A": s.radius * about(rng, 0.02, 0.08), "dent_th": th, "dent_w": rng.uniform(0.8, 3.0)}
    return _unlisted("the wire climbs over a crossing on the drum at one angle", "drum", "position", truth)


def _sheave_runout(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"sheave_e": s.radius * about(rng, 0.008, 0.03), "sheave_ph": rng.uniform(0.0, TURN)}
    return _unlisted("the sheave runs out of true", "sheave", "periodic", truth)


def _event(
    what: str, subsystem: str, name: str, draw: Callable[[np.random.Generator, Scales], float], *,
    longest_s: float = 4.0, logged: bool = False,
) -> Draw:  # fmt: skip
    """An event in one run: `name` of the truth, or of the log's sensor."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        size, event = draw(rng, s), drawn_event(rng, 0.5, longest_s)
        values, log = {name: size, "length_s": event.length_s}, {name: size} if logged else {}
        return _unlisted(
            f"event: {what}", subsystem, "event", {} if logged else {name: size}, values, log=log, event=event
        )

    return drawn


EVENTS: Mapping[str, Draw] = {
    "event_motor": _event("a blow of torque at the motor", "motor", "event_motor",
                          lambda rng, s: s.torque * either(rng, 0.04, 0.15)),
    "event_brake": _event("the brake grips while it should not", "brake", "event_brake",
                          lambda rng, s: s.torque * about(rng, 0.04, 0.15)),
    "event_drum": _event("a blow of torque at the drum", "drum", "event_drum",
                         lambda rng, s: s.torque * either(rng, 0.04, 0.15)),
    "event_sheave": _event("the sheave jams for a moment", "sheave", "event_sheave",
                           lambda rng, s: s.torque * about(rng, 0.04, 0.15)),
    "event_guide": _event("a foreign body in the rails, once", "guide", "event_guide",
                          lambda rng, s: s.force * about(rng, 0.05, 0.2)),
    "event_payload": _event("the payload strikes or is caught", "payload", "event_payload",
                            lambda rng, s: s.force * either(rng, 0.05, 0.2)),
    "event_platform": _event("the platform jolts", "platform", "event_platform",
                             lambda rng, s: 9.81 * either(rng, 0.015, 0.06)),
    "event_torque_sensor": _event("the torque sensor shows a bump that is none", "torque_sensor", "glitch",
                                  lambda rng, s: s.torque * either(rng, 0.04, 0.15), logged=True),
    "event_speed_sensor": _event("the encoder's coupling slips, and the speed is shown too low", "speed_sensor", "slip",
                                 lambda rng, s: about(rng, 0.05, 0.25), longest_s=2.0, logged=True),
}  # fmt: skip
UNLISTED: Mapping[str, Draw] = {
    "fan": _fan,
    "rail_step": _rail_step,
    "quadratic_drag": _quadratic,
    "roller": _roller,
    "gain_by_direction": _of_the_log(
        "the torque sensor's gain differs between hoisting and lowering", "load", "gain_hoisting", "gain_forward",
        lambda rng, s: about(rng, 0.015, 0.06) * float(rng.choice([-1.0, 1.0])),
    ),
    "foreign_body": _foreign_body,
    "torque_walk": _of_the_log("the torque sensor wanders", "time", "walk_nm_per_sqrt_s", "walk_per_sqrt_s",
                               lambda rng, s: s.torque * about(rng, 0.002, 0.008)),
    "soft_payload": _swinging_load,
    "dead_band": _of_the_log(
        "the torque log keeps its last value until the torque has changed by more than a dead band", "all",
        "dead_band_nm", "dead_band", lambda rng, s: s.torque * about(rng, 0.025, 0.07),
    ),
    "torque_bend": _of_the_log(  # the square of the torque is missing in the log: a saturating current sensor
        "the torque sensor saturates with the torque's square", "load", "bend_per_nm", "bend",
        lambda rng, s: about(rng, 0.02, 0.08) / s.torque,
    ),
    "swell": _swell,
    "tooth": _tooth,
    "wire_crossing": _dent,
    "sheave_runout": _sheave_runout,
    **EVENTS,
}  # fmt: skip
IN_THE_LIBRARY = ("fan", "rail_step", "quadratic_drag", "roller")  # of unlisted ones, where it goes beyond the format
