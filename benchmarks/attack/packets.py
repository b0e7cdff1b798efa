"""Packets for a served plant: `python -m benchmarks.attack.packets --packets 10000 --seed 0`.

Datagrams, Modbus frames and OPC UA chunks, most of them wrong, go to a hoist that is served in this process, while an
honest client asks now and then what the plant does. Tried is what docs/robustness.md promises: the plant's loop goes
on, every number that is shown is finite, the torque stays within the drive's limit, and a kind of complaint is one line
in five seconds. The same seed makes the same packets.
"""

from __future__ import annotations

import argparse
import json
import math
import random
import socket
import struct
import sys
import time
from collections import Counter
from collections.abc import Callable
from typing import Any

from benchmarks.serve import Client, Served, command_packet
from workbench.core.errors import InputError
from workbench.machines import default_hoist
from workbench.serve.session import SAID_EVERY_S
from workbench.serve.udp import BYTE_ORDER, COMMAND
from workbench.simulate.loop import torque_limits

NUMBERS = (0.0, -0.0, 1.0, -1.0, 1e3, 1e9, 1e300, -1e308, 1.8e308, math.nan, -math.nan, math.inf, -math.inf, 5e-324)
# As JSON has them, and as it has not: whole numbers beyond any float, words, shapes.
WORDS = (
    "0", "1", "-1", "2", "9000", "1e300", "-1e308", "1e999", "NaN", "-Infinity", "1" + 309 * "0", "9" * 5000, "true",
    "null", '"heavy"', "[]", "{}", "[1]", '"\\ud800"', '{"payload_kg": 1}', "0.30000000000000004",
)  # fmt: skip
NAMES = (
    "torque_motor_nm", "payload_kg", "slack_m", "brake_late_s", "brake_closed", "motor_lost", "reset", "time_s",
    "effects.friction_viscous.viscous_n_s_per_m", "payload", "", "é\\u0000", "x" * 3000,
)  # fmt: skip
CHECKED_EVERY = 200


def datagram(seed: int) -> bytes:
    """A command or an order, sound or not."""
    chance = random.Random(f"udp {seed}")
    value = chance.choice(NUMBERS)
    way = chance.randrange(8)
    if way == 0:
        return command_packet(seed, value, chance.getrandbits(32))
    if way == 1:  # of a machine of the other byte order
        return struct.pack(">4sIIId16s", b"WBC2", BYTE_ORDER, seed & 0xFFFFFFFF, 0, 500.0, b"")
    if way == 2:  # of version 1
        return struct.pack("<4sIIId", b"WBC1", seed, 0, 0, value)
    if way == 3:
        data = bytearray(command_packet(seed, 500.0))
        for _ in range(chance.choice([1, 3, 20])):
            data[chance.randrange(len(data))] = chance.randrange(256)
        return bytes(data[: chance.choice([len(data), len(data), chance.randrange(COMMAND.size)])])
    if way == 4:
        return chance.randbytes(chance.choice([0, 1, 40, 1400])) + chance.choice([b"", b"{"])
    pairs = ", ".join(f'"{chance.choice(NAMES)}": {chance.choice(WORDS)}' for _ in range(chance.choice([1, 1, 4])))
    orders = (
        f'{{"set": {{{pairs}}}}}', f'{{"set": {{{pairs}}}', f'{{"get": [{chance.choice(WORDS)}]}}',
        f'{{"get": "{chance.choice(NAMES)}"}}', '{"status": true, "points": 1}', f'{{"token": {chance.choice(WORDS)}}}',
        '{"set": ' + "[" * 20_000, '{"a": ' * 5_000, f'{{"set": {chance.choice(WORDS)}}}', '{"set": {"reset": 1}}',
    )  # fmt: skip
    return chance.choice(orders).encode("utf-8", "surrogatepass")[:60_000]


def modbus_frame(seed: int) -> bytes:
    """A request behind its head, sound or not."""
    chance = random.Random(f"modbus {seed}")
    function = chance.choice([1, 2, 3, 4, 5, 6, 15, 16, 0, 43, 127, 255])
    address, count = chance.choice([0, 1, 2, 8, 22, 200, 65535]), chance.choice([0, 1, 2, 4, 24, 125, 126, 2000, 65535])
    body = struct.pack(">BHH", function, address, count)
    if function in (15, 16):
        data = b"".join(
            struct.pack(">f", chance.choice([0.0, 900.0, 3e38, math.nan, math.inf])) for _ in range(count % 9)
        )
        body += bytes([chance.choice([len(data) % 256, 0, 255])]) + data
    body = body[: chance.choice([len(body), len(body), len(body), chance.randrange(1, len(body))])]
    length = chance.choice([len(body) + 1, len(body) + 1, len(body) + 1, 0, 1, 3, 65535])
    return struct.pack(">HHHB", seed % 65536, chance.choice([0, 0, 0, 7]), length, 1) + body


def opcua_chunk(seed: int) -> bytes:
    """A first message, sound or not, and what may follow it."""
    chance = random.Random(f"opcua {seed}")
    url = b"opc.tcp://127.0.0.1:1/"
    body = struct.pack("<IIIII", 0, 65536, 65536, 0, 0) + struct.pack("<I", len(url)) + url
    hello = b"HELF" + struct.pack("<I", len(body) + 8) + body
    second = chance.choice([b"OPN", b"MSG", b"CLO", b"HEL", b"XYZ"]) + chance.choice([b"F", b"C", b"A", b"?"])
    junk = chance.randbytes(chance.choice([0, 4, 40, 400]))
    size = chance.choice([len(junk) + 8] * 4 + [0, 7, 1 << 31])
    return (
        chance.choice([hello, hello, hello, hello[:20], chance.randbytes(30)]) + second + struct.pack("<I", size) + junk
    )


def _send_tcp(port: int, data: bytes) -> None:
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=5.0) as line:
            line.sendall(data)
            line.settimeout(0.02)
            line.recv(4096)
    except OSError:  # closed on us, as it should be, or no answer
        pass


def attack(protocol: str, packets: int, seed: int) -> dict[str, Any]:
    """Sends them all; what the plant promised and did not keep stands under "broken"."""
    machine = default_hoist()
    limit, broken = torque_limits(machine)["u_all"], []
    begun = time.monotonic()
    with Served(machine, protocol=protocol, watchdog_s=0.5, ready=("friction_viscous",)) as served:
        session, lines = served.session, [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        make: Callable[[int], bytes] = {"udp": datagram, "modbus": modbus_frame, "opcua": opcua_chunk}[protocol]
        for k in range(packets):
            data = make(seed * 1_000_000 + k)
            if protocol == "udp":
                lines[k % 2].sendto(data, ("127.0.0.1", served.port))
                time.sleep(0.002 if k % 10 == 9 else 0.0)
            else:
                _send_tcp(served.port, data)
            if k % CHECKED_EVERY == CHECKED_EVERY - 1:
                broken += _checked(served, limit)
                session.set({"reset": 1})
                session.command(session.plant.hold)
        steps = session.counts["steps"]
        session.command(session.plant.hold)
        ends = time.monotonic() + 20.0
        while session.counts["steps"] == steps and time.monotonic() < ends:
            time.sleep(0.01)
        if session.counts["steps"] == steps:
            broken.append("the loop has ended")
        for line in lines:
            line.close()
        refused = {name: count for name, count in session.counts.items() if name.startswith("refused")}
    spent = time.monotonic() - begun
    most_lines = (len(refused) + 2) * (1 + spent / SAID_EVERY_S)
    complaints = [line for line in served.said if "so far)" in line]
    if len(complaints) > most_lines:
        broken.append(f"{len(complaints)} lines of complaint in {spent:.0f} s")
    return {"protocol": protocol, "packets": packets, "seconds": spent, "lines": len(served.said),
            "refused": refused, "broken": dict(Counter(broken))}  # fmt: skip


def _checked(served: Served, limit: float) -> list[str]:
    """What is wrong with what the plant shows now."""
    session = served.session
    with session.lock:
        values = {point.name: point.read(session) for point in (*session.outputs, *session.inputs)}
    wrong = [f"{name} is {value}" for name, value in values.items() if not math.isfinite(value)]
    if not abs(values["torque_at_work_nm"]) <= limit * (1.0 + 1e-9):
        wrong.append("torque beyond the drive's limit")
    # The system drops datagrams of a flood: one answer of three will do.
    if "udp" in served.said[0] and not any(_answers(served.port) for _ in range(3)):
        wrong.append("no answer to three questions")
    json.dumps(values, allow_nan=False)
    return wrong


def _answers(port: int) -> bool:
    client = Client(port)
    try:
        return "status" in client.order({"get": ["time_s"], "status": True})
    except OSError:
        return False
    finally:
        client.close()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packets", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--protocols", default="udp,modbus,opcua")
    given = parser.parse_args()
    failed = False
    for protocol in given.protocols.split(","):
        try:
            found = attack(protocol, given.packets, given.seed)
        except InputError as error:
            print(f"{protocol}: {error}")
            continue
        failed = failed or bool(found["broken"])
        print(json.dumps(found))
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
