"""What the servers of networked protocols share: the extra they need, a free port, and one loop of asyncio."""

from __future__ import annotations

import asyncio
import importlib
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from workbench.errors import InputError
from workbench.serve.ports import free_tcp
from workbench.serve.session import Session


class AsyncServer(ABC):
    """The TCP server of one session. InputError where its package is missing or the port is taken."""

    protocol: ClassVar[str]
    package: ClassVar[str]

    def __init__(self, session: Session, address: str, port: int) -> None:
        try:
            importlib.import_module(self.package)
        except ImportError as error:
            raise InputError(f"the protocol {self.protocol} needs the extra 'serve': pip install '.[serve]'") from error
        self._session, self._address = session, address
        self.port = free_tcp(address, port)

    def close(self) -> None:  # noqa: B027 - the other servers hold a socket; these hold nothing beyond `run`
        """Nothing is held beyond `run`."""

    def run(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None:
        """In real time until `until(now)`: the plant in a thread of its own, the clients here."""
        asyncio.run(self._serve(until, listening))

    @abstractmethod
    async def _serve(self, until: Callable[[float], bool], listening: Callable[[], None]) -> None: ...

    def _taken(self) -> InputError:
        return InputError(f"port {self.port} of {self._address} is taken; choose another", place="port")
