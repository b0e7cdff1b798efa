"""The sizes of a machine, so that bounds and scales of effects fit a machine of any size."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Sizes:
    """What is large on one machine, SI; sizes["force/speed"] is a quotient of two.

    force: a hoist's weight of the empty carriage, an axis' largest input. torque: of all motors
    together, nominal; an axis' input. speed: of the carriage at nominal motor speed; an axis'
    largest. motor_speed: nominal. length: of the wire's fall; an axis' travel. radius,
    drum_angle: of the drum, and how far it turns for the whole length. mass: of the carriage.
    inertia: of drive and drum at the motor; of an axis.
    """

    kind: str
    force: float
    torque: float
    speed: float
    motor_speed: float
    length: float
    radius: float
    drum_angle: float
    mass: float
    inertia: float

    def __getitem__(self, size: str) -> float:
        numerator, _, denominator = size.partition("/")
        value = 1.0
        for word in numerator.split("*"):
            value *= self._one(word)
        for word in denominator.split("*") if denominator else ():
            value /= self._one(word)
        return value

    def _one(self, word: str) -> float:
        return 1.0 if word == "1" else float(getattr(self, word))

    @staticmethod
    def check(size: str) -> None:
        """KeyError for a quotient that names no size."""
        for word in size.replace("/", "*").split("*"):
            if word != "1" and (word == "kind" or word not in Sizes.__dataclass_fields__):
                known = ", ".join(name for name in Sizes.__dataclass_fields__ if name != "kind")
                raise KeyError(f"no size '{word}'; sizes: 1, {known}")
