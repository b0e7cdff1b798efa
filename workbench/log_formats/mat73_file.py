"""MATLAB logs of version 7.3, which are HDF5: one numeric vector per column."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from workbench.errors import InputError
from workbench.log_formats.declared import Limits, Opened

if TYPE_CHECKING:
    from workbench.run import Array

_NUMBERS = (b"double", b"single", b"logical", *(f"{s}int{b}".encode() for s in ("", "u") for b in (8, 16, 32, 64)))


def open_mat73(file: Path) -> Opened:
    """Lists the vectors at the top of the file. Scalars, matrices, text and structures are no columns."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            "is a version 7.3 file (HDF5); save it with: save('log.mat', '-v7'), or install the extra 'import'"
        ) from error
    held = h5py.File(file, "r")
    names = [name for name, item in held.items() if isinstance(item, h5py.Dataset) and _is_vector(item)]

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        return _pieces(held, wanted, limits)

    return Opened(names, pieces)


def _is_vector(item: Any) -> bool:
    kind = item.attrs.get("MATLAB_class", b"double")
    kind = kind.encode() if isinstance(kind, str) else bytes(kind)
    return kind in _NUMBERS and len(item.shape) == 2 and min(item.shape) == 1 and max(item.shape) > 1


def _pieces(held: Any, wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
    import numpy as np

    from workbench.log_formats.table import check_size

    check_size(max(held[name].size for name in wanted), sum(held[name].size for name in wanted), limits)
    for index, name in enumerate(wanted):
        values = np.asarray(held[name][()]).ravel()
        if values.dtype.kind not in "fiub":
            raise InputError(f"holds {values.dtype}, expected real numbers", place=name)
        yield index, np.ascontiguousarray(values, dtype=np.float64)
