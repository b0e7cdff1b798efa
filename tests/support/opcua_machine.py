"""A machine's drive as an OPC UA server that is not ours: asyncua's, with recorded cycles played into its nodes."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from workbench.core.run import Run

EPOCH = datetime(2026, 3, 1, 6, 0, 0, tzinfo=UTC)


class OpcUaMachine:
    """A server on a free port, in a thread of its own. Nodes ns=2;s=Drive.NAME; `rate` times faster than life."""

    def __init__(self, names: Sequence[str], port: int, rate: float = 1.0) -> None:
        self.names, self.rate, self.port = tuple(names), rate, port
        self.address = f"opc.tcp://127.0.0.1:{port}"
        self._latest = dict.fromkeys(self.names, 0.0)
        self._began = time.monotonic()
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self._server: Any = None
        self.up()

    def clock(self) -> float:
        """Seconds of this machine's life."""
        return (time.monotonic() - self._began) * self.rate

    def _do(self, what: Any) -> Any:
        return asyncio.run_coroutine_threadsafe(what, self._loop).result(60.0)

    def up(self) -> None:
        self._do(self._up())

    def down(self) -> None:
        self._do(self._server.stop())

    async def _up(self) -> None:
        from asyncua import Server, ua

        logging.getLogger("asyncua").setLevel(logging.CRITICAL)
        self._server = Server()
        await self._server.init()
        self._server.set_endpoint(self.address)
        self._server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        await self._server.register_namespace("urn:a:drive")
        for name in self.names:
            node = ua.NodeId(f"Drive.{name}", 2)
            await self._server.nodes.objects.add_variable(node, f"2:{name}", 0.0)
        await self._put(self._latest, self.clock())
        await self._server.start()

    def put(self, values: Mapping[str, float], at_s: float) -> None:
        """Values as of that second of the machine's life."""
        self._do(self._put(values, at_s))

    async def _put(self, values: Mapping[str, float], at_s: float) -> None:
        from asyncua import ua

        self._latest |= values
        for name, value in values.items():
            told = ua.DataValue(ua.Variant(float(value)), SourceTimestamp=EPOCH + timedelta(seconds=at_s))
            await self._server.write_attribute_value(ua.NodeId(f"Drive.{name}", 2), told)

    def play(self, run: Run, more: Mapping[str, float], until: Callable[[float], bool] = lambda t: False) -> None:
        """A run against the clock, from now on; until(t) ends it early. more: values that stay."""
        self._do(self._play(run, more, until))

    async def _play(self, run: Run, more: Mapping[str, float], until: Callable[[float], bool]) -> None:
        begun = self.clock()
        names = [name for name in self.names if name in run]
        await self._put(more, begun)
        for k, t in enumerate(np.asarray(run.time_s).tolist()):
            if until(t):
                return
            if (ahead := begun + t - self.clock()) > 0.02 * self.rate:
                await asyncio.sleep(ahead / self.rate)
            await self._put({name: float(run[name][k]) for name in names}, begun + t)
