"""The table of least torque peaks in benchmarks/least_peaks.md: `python -m benchmarks.least_peaks [--write]`.

Default machine, 0.7 m/s, 0.6 m/s², in the trapezoid's time. Without --write the table is printed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from workbench.machines import default_hoist, load_of, with_values
from workbench.references import Limits, move_shape, planned_kind
from workbench.references.least_peak import least_peak, peak_force_n

PAGE = Path(__file__).with_suffix(".md")
START, END = "<!-- made by python -m benchmarks.least_peaks -->", "<!-- end of least peaks -->"
LIMITS, RINGING_S = Limits(0.7, 0.6), 0.0025
CASES = ((12.0, 9000.0), (-12.0, 9000.0), (12.0, 0.0), (0.2, 9000.0), (-0.2, 9000.0))


def rows() -> list[str]:
    """N m a motor: the trapezoid followed exactly; a motion with the load at rest that exists; the bounds."""
    made = []
    for words, changes in (("", {}), (", wire ζ 0.02", {"wire.damping_time_s": RINGING_S})):
        machine = with_values(default_hoist(), changes)
        for distance, payload in CASES:
            load = load_of(machine, payload)
            assert load is not None
            trapezoid = move_shape(planned_kind("trapezoid"), distance, LIMITS)
            still, any_end = (
                least_peak(distance, 0.7, trapezoid.duration_s, load, at_rest) for at_rest in (True, False)
            )
            forces = peak_force_n(trapezoid, load), still.primal_n, still.dual_n, any_end.dual_n
            numbers = (f"{force * machine.lift_m_per_rad / machine.motor.count:.1f}" for force in forces)
            made.append(f"| {distance:g} m, {payload:g} kg{words} | {' | '.join(numbers)} |")
    return made


def table() -> str:
    columns = "move, payload", "trapezoid, followed exactly", "motion at rest, exists", "none at rest below"
    head = f"| {' | '.join((*columns, 'none at all below'))} |"
    return "\n".join([START, "", head, "|---|---|---|---|---|", *rows(), "", END])


def main() -> None:
    text = table()
    if "--write" not in sys.argv[1:]:
        print(text)
        return
    page = PAGE.read_text(encoding="utf-8")
    before, after = page.partition(START)[0], page.partition(END)[2]
    PAGE.write_text(before + text + after, encoding="utf-8")


if __name__ == "__main__":
    main()
