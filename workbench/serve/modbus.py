"""Modbus TCP: the points as registers and coils; docs/serve.md has the addresses.

Numbers are IEEE 754 float32, two registers each, the high word first. Holding registers: what may be written
(function 3, 6, 16), input registers: what is read (function 4), coils: switches that may be written (1, 5, 15),
discrete inputs: switches that are read (2). Addresses count from 0 in the order of `points`.
A torque is a command, also one of the same value: it feeds the watchdog.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from workbench.errors import InputError
from workbench.serve.pace import stepping
from workbench.serve.points import Point
from workbench.serve.server import AsyncServer
from workbench.serve.session import Session

READS_COILS, READS_INPUTS, READS_HOLDING, READS_REGISTERS = 1, 2, 3, 4
WRITES_COILS, WRITES_HOLDING = (5, 15), (6, 16)


@dataclass(frozen=True)
class Map:
    """The points by table: coils, discrete inputs, holding registers, input registers."""

    coils: tuple[Point, ...]
    discrete: tuple[Point, ...]
    holding: tuple[Point, ...]
    registers: tuple[Point, ...]


def map_of(inputs: Sequence[Point], outputs: Sequence[Point]) -> Map:
    def of(points: Sequence[Point], kind: str) -> tuple[Point, ...]:
        return tuple(point for point in points if point.kind == kind)

    return Map(of(inputs, "switch"), of(outputs, "switch"), of(inputs, "number"), of(outputs, "number"))


def words_of(value: float) -> tuple[int, int]:
    """A number as two registers, the high word first."""
    return struct.unpack(">HH", struct.pack(">f", value))


def number_of(words: Sequence[int]) -> float:
    return float(struct.unpack(">f", struct.pack(">HH", *words))[0])


class ModbusServer(AsyncServer):
    """The server of one session."""

    protocol = "modbus"
    package = "pymodbus"

    def __init__(self, session: Session, address: str, port: int) -> None:
        super().__init__(session, address, port)
        self._map = map_of(session.inputs, session.outputs)

    async def _serve(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        from pymodbus.server import ModbusTcpServer
        from pymodbus.simulator import DataType, SimData, SimDevice

        def table(points: Sequence[Point], kind: Any) -> list[Any]:
            bits = kind is DataType.BITS  # sixteen to a register
            zeros: list[Any] = [False] * (-(-len(points) // 16) * 16) if bits else [0] * (2 * len(points))
            return [SimData(0, values=zeros, datatype=kind)]

        m = self._map
        tables = (
            table(m.coils, DataType.BITS), table(m.discrete, DataType.BITS),
            table(m.holding, DataType.REGISTERS), table(m.registers, DataType.REGISTERS),
        )  # fmt: skip
        server = ModbusTcpServer(SimDevice(0, simdata=tables, action=self._action), address=(self._address, self.port))
        try:
            await server.serve_forever(background=True)
        except (RuntimeError, OSError) as error:
            raise self._taken() from error
        plant = stepping(self._session.pace, self._session.step, until)
        listening()
        try:
            while plant.is_alive():
                await asyncio.sleep(0.02)
        finally:
            await server.shutdown()

    async def _action(
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        registers: list[Any],
        values: list[Any] | None,
    ) -> Any:
        """pymodbus asks before it reads or writes: registers are made fresh, what is written becomes a command."""
        from pymodbus.constants import ExcCodes

        session, m = self._session, self._map
        try:
            if function_code in WRITES_COILS and values is not None:
                for point, value in zip(m.coils[address:], values, strict=False):
                    session.set(point.name, int(bool(value)))
            elif function_code in WRITES_HOLDING and values is not None:
                self._write(address, [int(value) for value in values])
            else:
                self._fresh(function_code, start_address, registers)
        except InputError as error:
            session.refused("value", str(error))
            return ExcCodes.ILLEGAL_VALUE
        return None

    def _write(self, address: int, words: list[int]) -> None:
        if address % 2 or len(words) % 2:
            raise InputError(
                f"{len(words)} registers from {address} on: a number is two registers and begins at an even one"
            )
        first = address // 2
        for i, point in enumerate(self._map.holding[first : first + len(words) // 2]):
            self._session.set(point.name, number_of(words[2 * i : 2 * i + 2]))

    def _fresh(self, function_code: int, start: int, registers: list[Any]) -> None:
        """The whole table that a client reads from, as it is now; registers[0] has the address `start`, 0 for bits."""
        m, session = self._map, self._session
        with session.lock:
            if function_code in (READS_COILS, READS_INPUTS):
                points = m.coils if function_code == READS_COILS else m.discrete
                for k in range(len(registers)):
                    sixteen = enumerate(points[16 * k : 16 * k + 16])
                    registers[k] = sum(1 << bit for bit, point in sixteen if point.read(session))
            else:
                points = m.holding if function_code == READS_HOLDING else m.registers
                for i, point in enumerate(points):
                    for j, word in enumerate(words_of(point.read(session))):
                        if 0 <= 2 * i + j - start < len(registers):
                            registers[2 * i + j - start] = word
