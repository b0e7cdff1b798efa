"""MATLAB logs: one numeric vector per column."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.logs.formats.declared import Limits, LogFormat, Opened, real_numbers

_HDF5 = b"\x89HDF"
_KINDS = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))


def open_mat(file: Path) -> Opened:
    """Lists the vectors. Scalars, matrices, text and structures are no columns."""
    with file.open("rb") as stream:
        start = stream.read(1024)
    if not start:
        raise InputError("is empty")
    if _HDF5 in start or start.startswith(b"MATLAB 7.3"):
        return _open73(file)
    if not any(start):
        raise InputError("is not a readable MAT file: it begins with zeros")
    import scipy.io

    def values(name: str) -> Array:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # scipy warns where it guesses
            return np.asarray(scipy.io.loadmat(str(file), variable_names=[name])[name])

    return _vectors({str(name): shape for name, shape, kind in scipy.io.whosmat(str(file)) if kind in _KINDS}, values)


def _open73(file: Path) -> Opened:
    """A file of version 7.3, which is HDF5."""
    try:
        import h5py
    except ImportError as error:
        said = "is a version 7.3 file (HDF5); save it with: save('log.mat', '-v7'), or install the extra 'import'"
        raise InputError(said) from error
    while h5py.h5pl.size():  # a data set may ask for a filter, which is a library looked for in these folders
        h5py.h5pl.remove(0)
    held = h5py.File(file, "r")
    for name in held:
        _check_within(held, name)
    shapes = {}
    for name, item in held.items():
        kind = item.attrs.get("MATLAB_class", b"double")
        kind = kind if isinstance(kind, str) else bytes(kind).decode(errors="replace")
        if isinstance(item, h5py.Dataset) and kind in _KINDS:
            shapes[name] = item.shape
    return _vectors(shapes, lambda name: np.asarray(held[name][()]))


def _check_within(held: Any, name: str) -> None:
    """InputError for what HDF5 would follow out of the file: links by path, external storage, virtual data sets."""
    import h5py

    why = ""
    if not isinstance(held.get(name, getlink=True), h5py.HardLink):
        why = "is a link to another place or file"
    elif isinstance(item := held[name], h5py.Dataset) and item.external:
        why = "keeps its samples in another file"
    elif isinstance(item, h5py.Dataset) and item.is_virtual:
        why = "is put together of other data sets"
    if why:
        raise InputError(f"{why}; expected samples in the file itself, as MATLAB saves them", place=name)


def _vectors(shapes: Mapping[str, tuple[int, ...]], values: Callable[[str], Array]) -> Opened:
    """Vector by vector: each is unpacked as a whole, so that its header is asked for its length first."""
    lengths = {name: max(s) for name, s in shapes.items() if len(s) == 2 and min(s) == 1 and max(s) > 1}

    def pieces(wanted: Sequence[str], limits: Limits) -> Iterator[tuple[int, Array]]:
        limits.check(max(lengths[name] for name in wanted), sum(lengths[name] for name in wanted))
        for index, name in enumerate(wanted):
            yield index, real_numbers(name, values(name).ravel())

    return Opened(list(lengths), pieces)


MAT = LogFormat(
    name="MAT",
    suffixes=(".mat",),
    open=open_mat,
    about=(
        "MATLAB, one real vector per column; version 7.3 (HDF5) with the extra `import`, else save with "
        "`save('log.mat', '-v7')`. Scalars, matrices, text and structures are no columns."
    ),
    imports=("scipy.io", "scipy.io.matlab", "h5py"),
)
