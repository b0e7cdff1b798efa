"""What can ail a hoist: the effects of the campaign format, each with its size drawn, and causes that no list holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.validation.kind import TURN, Cause, about, drawn_event, either
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


def _viscous(rng: np.random.Generator, s: Scales) -> Cause:
    B = s.force / s.speed * about(rng, 0.015, 0.075)
    return Cause(
        "friction_viscous", "guide", "speed", {"B_visc": B}, {"B_up": B, "B_dn": B},
        library={"friction_viscous": {"viscous_n_s_per_m": B}},
    )  # fmt: skip


def _viscous_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large = s.force / s.speed * about(rng, 0.025, 0.10)
    small = large * rng.uniform(0.0, 0.45)
    up, dn = (large, small) if rng.random() < 0.5 else (small, large)
    return Cause(
        "friction_viscous_asymmetric", "guide", "speed", {"B_up": up, "B_dn": dn}, {"B_up": up, "B_dn": dn},
        library={
            "friction_viscous_asymmetric": {"viscous_hoisting_n_s_per_m": up, "viscous_lowering_n_s_per_m": dn}
        },
    )  # fmt: skip


def _coulomb(rng: np.random.Generator, s: Scales) -> Cause:
    F = s.force * about(rng, 0.045, 0.13)
    if rng.random() < 0.25:  # less friction than the engineer believes
        F = -rng.uniform(0.55, 0.85) * min(s.levels)
    return Cause(
        "friction_coulomb", "guide", "all", {"dF": F}, {"dF_up": F, "dF_dn": F},
        library={"friction_coulomb": {"level_n": F}},
    )  # fmt: skip


def _coulomb_asymmetric(rng: np.random.Generator, s: Scales) -> Cause:
    large = s.force * about(rng, 0.05, 0.13)
    small = large * rng.uniform(-0.1, 0.3)
    up, dn = (large, small) if rng.random() < 0.5 else (small, large)
    return Cause(
        "friction_coulomb_asymmetric", "guide", "all", {"dF_up": up, "dF_dn": dn}, {"dF_up": up, "dF_dn": dn},
        library={"friction_coulomb_asymmetric": {"level_hoisting_n": up, "level_lowering_n": dn}},
        alike=_LEVEL_LIKE,
    )  # fmt: skip


def _stribeck(rng: np.random.Generator, s: Scales) -> Cause:
    up, dn = s.force * about(rng, 0.03, 0.12), s.force * about(rng, 0.03, 0.12)
    v = s.speed * about(rng, 0.03, 0.11)
    return Cause(
        "friction_stribeck", "guide", "low_speed", {"Fs_up": up, "Fs_dn": dn, "v_str": v},
        {"Fs_up": up, "Fs_dn": dn, "v_str": v},
        library={
            "friction_stribeck": {"peak_hoisting_n": up, "peak_lowering_n": dn, "stribeck_speed_m_s": v}
        },
    )  # fmt: skip


def _load(rng: np.random.Generator, s: Scales) -> Cause:
    a = about(rng, 0.03, 0.14)
    return Cause(
        "friction_load_dependent", "guide", "load", {"a_load": a}, {"a_load": a},
        library={"friction_load_dependent": {"friction_fraction": a}},
    )  # fmt: skip


def _bump(rng: np.random.Generator, s: Scales) -> Cause:
    A, w = s.force * about(rng, 0.028, 0.12), about(rng, 0.25, 0.8)
    x = rng.uniform(*s.heights(0.3))
    return Cause(
        "friction_position_dependent", "guide", "position", {"bump_A": A, "bump_x": x, "bump_w": w},
        {"bump_A": A, "bump_x": x, "bump_w": w},
        library={"friction_position_dependent": {"peak_n": A, "centre_m": x, "width_m": w}},
    )  # fmt: skip


def _drift(rng: np.random.Generator, s: Scales) -> Cause:
    a, tau = about(rng, 0.4, 1.6), about(rng, 120.0, 450.0)
    return Cause(
        "friction_thermal_drift", "guide", "time", {"drift_a": a, "drift_tau": tau},
        {"drift_a": a, "drift_tau": tau},
        library={"friction_thermal_drift": {"friction_fraction": a, "time_constant_s": tau}},
    )  # fmt: skip


def _gear_loss(rng: np.random.Generator, s: Scales) -> Cause:
    eta = about(rng, 0.017, 0.075)
    return Cause(
        "gearbox_efficiency", "gearbox", "load", {"eta_loss": eta}, {"eta_loss": eta},
        library={"gearbox_efficiency": {"loss_fraction": eta}},
    )  # fmt: skip


def _gear_inertia(rng: np.random.Generator, s: Scales) -> Cause:
    Jg = s.inertia * about(rng, 0.09, 0.4)
    return Cause(
        "gearbox_inertia", "gearbox", "acceleration", {"Jg": Jg}, {"Jg": Jg},
        library={"gearbox_inertia": {"inertia_kg_m2": Jg}},
    )  # fmt: skip


def _brake(rng: np.random.Generator, s: Scales) -> Cause:
    T, tau = s.torque * about(rng, 0.035, 0.15), about(rng, 0.4, 1.8)
    return Cause(
        "brake_drag", "brake", "start", {"brk_T": T, "brk_tau": tau}, {"brk_T": T, "brk_tau": tau},
        library={"brake_drag": {"torque_nm": T, "time_constant_s": tau}},
    )  # fmt: skip


def _layer(rng: np.random.Generator, s: Scales) -> Cause:
    dR = s.radius * about(rng, 0.014, 0.065)
    th = 2.0 * rng.uniform(*s.heights(0.5)) / s.radius
    return Cause(
        "drum_layer_change", "drum", "position", {"layer_dR": dR, "layer_th": th},
        {"layer_dR": dR, "layer_th": th},
        library={"drum_layer_change": {"radius_step_m": dR, "drum_angle_rad": th}},
    )  # fmt: skip


def _eccentricity(rng: np.random.Generator, s: Scales) -> Cause:
    e, ph = s.radius * about(rng, 0.004, 0.035), rng.uniform(0.0, TURN)
    return Cause(
        "drum_eccentricity", "drum", "periodic", {"ecc_e": e, "ecc_ph": ph}, {"ecc_e": e, "ecc_ph": ph},
        library={"drum_eccentricity": {"amplitude_m": e, "phase_rad": ph}},
    )  # fmt: skip


def _wire(rng: np.random.Generator, s: Scales) -> Cause:
    extra = s.line_kg_per_m * about(rng, 0.01, 0.04)
    return Cause(
        "wire_mass", "wire", "position", {"wire_extra": extra}, {"rho_extra": extra},
        library={"wire_mass": {"mass_kg_per_m": extra}},
    )  # fmt: skip


def _stiffness_length(rng: np.random.Generator, s: Scales) -> Cause:
    return Cause(
        "wire_stiffness_length", "wire", "position", {"k_share": 1.0}, {"k_share": 1.0},
        library={"wire_stiffness_length": {"share": 1.0}},
    )  # fmt: skip


def _heave(rng: np.random.Generator, s: Scales) -> Cause:
    A, w = about(rng, 0.08, 0.4), rng.uniform(0.45, 1.1)
    return Cause(
        "heave", "platform", "time", {"heave_A": A, "heave_w": w}, {"heave_A": A, "heave_w": w},
        per_run={"heave_ph": (0.0, TURN)},
        library={"heave": {"amplitude_m": A, "frequency_rad_s": w}},
    )  # fmt: skip


def _carriage_mass(rng: np.random.Generator, s: Scales) -> Cause:
    m = s.force / 9.81 * either(rng, 0.03, 0.11)
    return Cause(
        "carriage_mass_error", "payload", "all", {"m_c": m}, {"dm_c": m},
        library={"carriage_mass_error": {"mass_kg": m}}, alike=_LEVEL_LIKE,
    )  # fmt: skip


def _payload_mass(rng: np.random.Generator, s: Scales) -> Cause:
    scale = 1.0 + either(rng, 0.025, 0.11)
    return Cause(
        "payload_mass_error", "payload", "load", {"mp_scale": scale}, {"mp_scale": scale},
        library={"payload_mass_error": {"payload_scale": scale}},
    )  # fmt: skip


def _gain(rng: np.random.Generator, s: Scales) -> Cause:
    gain = 1.0 + either(rng, 0.03, 0.13)
    return Cause(
        "torque_scale", "torque_sensor", "all", {"t_gain": gain}, log={"gain": gain},
        library={"torque_scale": {"gain": gain}},
    )  # fmt: skip


def _offset(rng: np.random.Generator, s: Scales) -> Cause:
    offset = s.torque * either(rng, 0.02, 0.08)
    return Cause(
        "torque_offset", "torque_sensor", "all", {"t_off": offset}, log={"offset": offset},
        library={"torque_offset": {"offset_nm": offset}}, alike=_LEVEL_LIKE,
    )  # fmt: skip


def _filter(rng: np.random.Generator, s: Scales) -> Cause:
    tau = about(rng, 0.08, 0.4)
    return Cause(
        "torque_filter", "torque_sensor", "acceleration", {"t_tau": tau}, log={"filter_s": tau},
        library={"torque_filter": {"time_constant_s": tau}},
    )  # fmt: skip


def _delay(rng: np.random.Generator, s: Scales) -> Cause:
    delay = about(rng, 0.05, 0.3)
    return Cause(
        "speed_delay", "speed_sensor", "acceleration", {"w_delay": delay}, log={"delay_s": delay},
        library={"speed_delay": {"delay_s": delay}},
    )  # fmt: skip


def _ripple(rng: np.random.Generator, s: Scales) -> Cause:
    A, n, ph = s.torque * about(rng, 0.009, 0.04), float(rng.choice([1.0, 1.0, 2.0])), rng.uniform(0.0, TURN)
    return Cause(
        "torque_ripple", "motor", "periodic", {"ripple_A": A, "ripple_n": n, "ripple_ph": ph},
        {"ripple_A": A, "ripple_n": n, "ripple_ph": ph},
        library={"torque_ripple": {"amplitude_nm": A, "order_per_turn": n, "phase_rad": ph}},
    )  # fmt: skip


def _backlash(rng: np.random.Generator, s: Scales) -> Cause:
    play = about(rng, 0.005, 0.04)
    return Cause(
        "backlash", "gearbox", "event", {"play": play}, {"play": play}, library={"backlash": {"play_rad": play}}
    )


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
    "torque_scale": _gain,
    "torque_offset": _offset,
    "torque_filter": _filter,
    "speed_delay": _delay,
    "torque_ripple": _ripple,
    "backlash": _backlash,
}
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


def _fan(rng: np.random.Generator, s: Scales) -> Cause:
    q = s.torque * about(rng, 0.02, 0.09) / s.motor_speed**2
    text = "unlisted: drag on the motor that grows with the square of its speed"
    return Cause(
        text, "motor", "speed", {"fan_q": q}, {"fan_q": q}, library={"motor_fan": {"drag_nm_s2": q}}
    )  # fmt: skip


def _rail_step(rng: np.random.Generator, s: Scales) -> Cause:
    A, x = s.force * about(rng, 0.02, 0.08), rng.uniform(*s.heights(0.8))
    text = "unlisted: the rail changes its friction at one height"
    return Cause(
        text, "guide", "position", {"step_A": A, "step_x": x}, {"step_A": A, "step_x": x},
        library={"friction_step": {"level_n": A, "position_m": x}},
    )  # fmt: skip


def _quadratic(rng: np.random.Generator, s: Scales) -> Cause:
    c = s.force / s.speed**2 * about(rng, 0.02, 0.09)
    text = "unlisted: drag on the carriage that grows with the square of its speed"
    return Cause(
        text, "guide", "speed", {"drag_c": c}, {"drag_c": c}, library={"friction_quadratic": {"drag_n_s2_per_m2": c}}
    )  # fmt: skip


def _roller(rng: np.random.Generator, s: Scales) -> Cause:
    A, d, ph = s.force * about(rng, 0.03, 0.10), about(rng, 0.35, 1.4), rng.uniform(0.0, TURN)
    text = "unlisted: friction that comes and goes over the height with a roller's turning"
    return Cause(
        text, "guide", "periodic", {"roller_A": A, "roller_d": d, "roller_ph": ph},
        {"roller_A": A, "roller_d": d, "roller_ph": ph},
        library={"friction_periodic": {"amplitude_n": A, "period_m": d, "phase_rad": ph}},
    )  # fmt: skip


def _gain_by_direction(rng: np.random.Generator, s: Scales) -> Cause:
    gain = about(rng, 0.015, 0.06) * float(rng.choice([-1.0, 1.0]))
    text = "unlisted: the torque sensor's gain differs between hoisting and lowering"
    return Cause(text, "torque_sensor", "load", {"gain_hoisting": gain}, log={"gain_forward": gain})


def _foreign_body(rng: np.random.Generator, s: Scales) -> Cause:
    F, tau = s.force * about(rng, 0.025, 0.09), about(rng, 0.3, 8.0)
    text = "unlisted: friction that sets in at some moment of each run, as of a foreign body"
    return Cause(
        text, "guide", "time", {"body_F": F, "body_tau": tau}, {"body_F": F, "body_tau": tau},
        per_run={"body_t": (5.0, 25.0)},
    )  # fmt: skip


def _walk(rng: np.random.Generator, s: Scales) -> Cause:
    walk = s.torque * about(rng, 0.002, 0.008)
    text = "unlisted: the torque sensor wanders"
    return Cause(text, "torque_sensor", "time", {"walk_nm_per_sqrt_s": walk}, log={"walk_per_sqrt_s": walk})


def _swinging_load(rng: np.random.Generator, s: Scales) -> Cause:
    """A share of the payload on a soft spring."""
    share, f, zeta = rng.uniform(0.5, 0.95), rng.uniform(0.35, 1.0), rng.uniform(0.01, 0.06)
    text = "unlisted: the payload hangs on a soft spring"
    m, w = share * s.payload_kg, TURN * f  # the full payload swings with f, a lesser one faster
    truth = {"hook_share": share, "hook_k": m * w * w, "hook_c": 2.0 * zeta * w * m}
    return Cause(text, "payload", "acceleration", {"hook_share": share, "hook_hz": f, "hook_zeta": zeta}, truth)


def _dead_band(rng: np.random.Generator, s: Scales) -> Cause:
    band = s.torque * about(rng, 0.025, 0.07)
    text = "unlisted: the torque log keeps its last value until the torque has changed by more than a dead band"
    return Cause(text, "torque_sensor", "all", {"dead_band_nm": band}, log={"dead_band": band})


def _bend(rng: np.random.Generator, s: Scales) -> Cause:
    """The square of the torque is missing in the log: a saturating current sensor."""
    bend = about(rng, 0.02, 0.08) / s.torque
    text = "unlisted: the torque sensor saturates with the torque's square"
    return Cause(text, "torque_sensor", "load", {"bend_per_nm": bend}, log={"bend": bend})


def _swell(rng: np.random.Generator, s: Scales) -> Cause:
    A, w, more = about(rng, 0.08, 0.3), rng.uniform(0.45, 0.9), rng.uniform(1.25, 1.6)
    text = "unlisted: the platform moves in a swell of two frequencies"
    truth = {"heave_A": A, "heave_w": w, "swell_A": A / more, "swell_w": w * more}
    phases = {"heave_ph": (0.0, TURN), "swell_ph": (0.0, TURN)}
    return Cause(text, "platform", "time", truth, truth, per_run=phases)


def _tooth(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"tooth_T": s.torque * about(rng, 0.03, 0.12), "tooth_w": rng.uniform(0.2, 0.5)}
    truth["tooth_ph"] = rng.uniform(0.0, TURN)
    text = "unlisted: a damaged tooth of the gear's last wheel drags once a turn"
    return Cause(text, "gearbox", "periodic", truth, truth)


def _dent(rng: np.random.Generator, s: Scales) -> Cause:
    """The arm is longer there: more torque at one angle, in proportion to what hangs, both ways alike."""
    th = 2.0 * rng.uniform(*s.heights(0.6)) / s.radius
    truth = {"dent_A": s.radius * about(rng, 0.02, 0.08), "dent_th": th, "dent_w": rng.uniform(0.8, 3.0)}
    text = "unlisted: the wire climbs over a crossing on the drum at one angle"
    return Cause(text, "drum", "position", truth, truth)


def _sheave_runout(rng: np.random.Generator, s: Scales) -> Cause:
    truth = {"sheave_e": s.radius * about(rng, 0.008, 0.03), "sheave_ph": rng.uniform(0.0, TURN)}
    text = "unlisted: the sheave runs out of true"
    return Cause(text, "sheave", "periodic", truth, truth)


def _event(what: str, subsystem: str, name: str, low: float, high: float, *, of_force: bool, signed: bool) -> Draw:
    """An event in one run: `name` of the truth, of the empty carriage's weight or of the motors' torque."""

    def drawn(rng: np.random.Generator, s: Scales) -> Cause:
        size = (s.force if of_force else s.torque) * (either(rng, low, high) if signed else about(rng, low, high))
        event = drawn_event(rng, 0.5, 4.0)
        values = {name: size, "length_s": event.length_s}
        return Cause(f"unlisted: event: {what}", subsystem, "event", values, {name: size}, event=event)

    return drawn


def _jolt(rng: np.random.Generator, s: Scales) -> Cause:
    jolt, event = 9.81 * either(rng, 0.015, 0.06), drawn_event(rng, 0.5, 4.0)
    values = {"event_platform": jolt, "length_s": event.length_s}
    text = "unlisted: event: the platform jolts"
    return Cause(text, "platform", "event", values, {"event_platform": jolt}, event=event)


def _glitch(rng: np.random.Generator, s: Scales) -> Cause:
    size, event = s.torque * either(rng, 0.04, 0.15), drawn_event(rng, 0.5, 4.0)
    text = "unlisted: event: the torque sensor shows a bump that is none"
    return Cause(
        text, "torque_sensor", "event", {"glitch": size, "length_s": event.length_s}, log={"glitch": size}, event=event
    )


def _slip(rng: np.random.Generator, s: Scales) -> Cause:
    slip, event = about(rng, 0.05, 0.25), drawn_event(rng, 0.5, 2.0)
    text = "unlisted: event: the encoder's coupling slips, and the speed is shown too low"
    return Cause(
        text, "speed_sensor", "event", {"slip": slip, "length_s": event.length_s}, log={"slip": slip}, event=event
    )


EVENTS: Mapping[str, Draw] = {
    "event_motor": _event(
        "a blow of torque at the motor", "motor", "event_motor", 0.04, 0.15, of_force=False, signed=True
    ),
    "event_brake": _event(
        "the brake grips while it should not", "brake", "event_brake", 0.04, 0.15, of_force=False, signed=False
    ),
    "event_drum": _event(
        "a blow of torque at the drum", "drum", "event_drum", 0.04, 0.15, of_force=False, signed=True
    ),
    "event_sheave": _event(
        "the sheave jams for a moment", "sheave", "event_sheave", 0.04, 0.15, of_force=False, signed=False
    ),
    "event_guide": _event(
        "a foreign body in the rails, once", "guide", "event_guide", 0.05, 0.2, of_force=True, signed=False
    ),
    "event_payload": _event(
        "the payload strikes or is caught", "payload", "event_payload", 0.05, 0.2, of_force=True, signed=True
    ),
    "event_platform": _jolt,
    "event_torque_sensor": _glitch,
    "event_speed_sensor": _slip,
}  # fmt: skip
UNLISTED: Mapping[str, Draw] = {
    "fan": _fan,
    "rail_step": _rail_step,
    "quadratic_drag": _quadratic,
    "roller": _roller,
    "gain_by_direction": _gain_by_direction,
    "foreign_body": _foreign_body,
    "torque_walk": _walk,
    "soft_payload": _swinging_load,
    "dead_band": _dead_band,
    "torque_bend": _bend,
    "swell": _swell,
    "tooth": _tooth,
    "wire_crossing": _dent,
    "sheave_runout": _sheave_runout,
    **EVENTS,
}
IN_THE_LIBRARY = ("fan", "rail_step", "quadratic_drag", "roller")  # of unlisted ones, where it goes beyond the format
