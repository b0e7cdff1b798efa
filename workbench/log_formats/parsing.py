"""Errors of parsers as one InputError, in this process and in a worker."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from workbench.errors import InputError
from workbench.log_formats.declared import MB, Limits


@contextmanager
def plain_errors(format_name: str, limits: Limits) -> Iterator[None]:
    """Whatever a parser raises on a damaged file becomes an InputError. The caller adds the file's name."""
    try:
        yield
    except InputError:
        raise
    except MemoryError as error:
        raise InputError(
            f"takes more than the {limits.memory_bytes / MB:g} MB of memory that a log may; is it damaged?"
        ) from error
    except Exception as error:
        if isinstance(error, OSError) and error.errno and error.strerror:
            raise InputError(f"cannot be read: {error.strerror}") from error
        first = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise InputError(f"is not a readable {format_name} file: {first[:200]}") from error
