"""OPC UA: the points as nodes of an object "Plant"; docs/serve.md has their names.

Plant/Inputs/NAME may be written, Plant/Outputs/NAME are read; both by the names of `points`, numbers as Double,
switches as Boolean, in the namespace of `NAMESPACE`. No security: the server is for a test bench.
A torque is a command, also one of the same value: it feeds the watchdog.
"""

from __future__ import annotations

import asyncio
import datetime
import logging
from collections.abc import Callable
from typing import Any

from workbench.errors import InputError
from workbench.serve.pace import stepping
from workbench.serve.points import Point
from workbench.serve.server import AsyncServer

NAMESPACE = "urn:workbench:plant"
REFRESH_S = 0.05  # how often values are written for clients that subscribe; who reads gets the value of now


class OpcUaServer(AsyncServer):
    """The server of one session."""

    protocol = "opcua"
    package = "asyncua"

    async def _serve(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        from asyncua import Server, ua

        logging.getLogger("asyncua").setLevel(logging.ERROR)
        server = Server()
        await server.init()
        server.set_endpoint(f"opc.tcp://{self._address}:{self.port}/")
        server.set_server_name("workbench plant")
        server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        space = await server.register_namespace(NAMESPACE)
        plant = await server.nodes.objects.add_object(ua.NodeId("Plant", space), f"{space}:Plant")
        outputs = []
        for folder, points in (("Inputs", self._session.inputs), ("Outputs", self._session.outputs)):
            parent = await plant.add_object(ua.NodeId(f"Plant.{folder}", space), f"{space}:{folder}")
            for point in points:
                made = await self._node(server, parent, point, folder, space)
                if folder == "Outputs":
                    outputs.append((point, made))
        try:
            await server.start()
        except OSError as error:
            raise self._taken() from error
        steps = stepping(self._session.pace, self._session.step, until)
        listening()
        try:
            while steps.is_alive():
                await asyncio.sleep(REFRESH_S)
                for point, node in outputs:
                    await server.write_attribute_value(node.nodeid, self._now(point))
                    self._reads_now(server, point, node)
        finally:
            await server.stop()

    async def _node(self, server: Any, parent: Any, point: Point, folder: str, space: int) -> Any:
        from asyncua import ua

        session = self._session
        value: float | bool = bool(point.read(session)) if point.kind == "switch" else float(point.read(session))
        node = await parent.add_variable(
            ua.NodeId(f"Plant.{folder}.{point.name}", space),
            f"{space}:{point.name}",
            value,
        )
        unit = f" ({point.unit})" if point.unit else ""
        described = ua.DataValue(ua.Variant(ua.LocalizedText(f"{point.meaning}{unit}")))
        await node.write_attribute(ua.AttributeIds.Description, described)
        if point.write is not None:
            await node.set_writable()
            server.set_attribute_value_setter(node.nodeid, self._setter(point))
        self._reads_now(server, point, node)
        return node

    def _reads_now(self, server: Any, point: Point, node: Any) -> None:
        server.set_attribute_value_callback(node.nodeid, lambda *_: self._now(point))

    def _setter(self, point: Point) -> Callable[[Any, Any, Any], None]:
        """Takes what a client writes. ServiceError, which the client sees, for a value that cannot be."""
        from asyncua import ua

        def set_value(data: Any, attribute: Any, value: Any) -> None:
            try:
                self._session.set(point.name, value.Value.Value)
            except InputError as error:
                self._session.refused("value", str(error))
                raise ua.UaStatusCodeError(ua.StatusCodes.BadOutOfRange) from error

        return set_value

    def _now(self, point: Point) -> Any:
        from asyncua import ua

        with self._session.lock:
            value = point.read(self._session)
        variant = ua.Variant(bool(value) if point.kind == "switch" else float(value))
        return ua.DataValue(variant, SourceTimestamp=datetime.datetime.now(datetime.UTC))
