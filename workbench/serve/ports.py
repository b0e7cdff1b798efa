"""A port to listen on, or one clear line why it cannot be had."""

from __future__ import annotations

import socket

from workbench.errors import InputError


def udp_socket(address: str, port: int) -> socket.socket:
    """A socket that does not block. InputError where the port is taken or not ours."""
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_DGRAM)[0][0]
        made = socket.socket(family, socket.SOCK_DGRAM)
    except OSError as error:
        raise InputError(f"address {address} is not known: {error.strerror}", place="address") from error
    try:
        made.bind((address, port))
    except OSError as error:
        made.close()
        raise InputError(
            f"port {port} of {address} is taken or not ours to use ({error.strerror}); choose another", place="port"
        ) from error
    made.setblocking(False)
    return made


def free_tcp(address: str, port: int) -> int:
    """The port, or a free one for 0. InputError where it is taken or not ours."""
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address, port))
            return int(probe.getsockname()[1])
    except OSError as error:
        raise InputError(
            f"port {port} of {address} is taken or not ours to use ({error.strerror}); choose another", place="port"
        ) from error
