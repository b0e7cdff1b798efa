"""MATLAB logs (version 7 and older): one numeric vector per column."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from workbench.errors import InputError
from workbench.logs.table import LogFile, Table, doubled, row_number
from workbench.run import Array

_HDF5 = b"\x89HDF"


def open_mat(file: Path) -> LogFile:
    """Lists the vectors. Scalars, matrices, text and structures are no columns."""
    with file.open("rb") as stream:
        start = stream.read(1024)
    if not start:
        raise InputError("is empty", file=file)
    if _HDF5 in start or start.startswith(b"MATLAB 7.3"):
        raise InputError("is a version 7.3 file (HDF5); save it with: save('log.mat', '-v7')", file=file)
    import scipy.io

    try:
        contents = scipy.io.whosmat(str(file))
    except Exception as error:  # a damaged file makes scipy raise almost anything
        raise _broken(file, error) from error
    kinds = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
    if (twice := doubled([str(name) for name, _, _ in contents])) is not None:
        raise InputError(f"variable '{twice}' is doubled", file=file)
    names = tuple(
        str(name)
        for name, shape, kind in contents
        if kind in kinds and len(shape) == 2 and min(shape) == 1 and max(shape) > 1
    )

    def read(wanted: Sequence[str]) -> Table:
        return Table(file, _read(file, wanted), row_number)

    return LogFile(file, names, read)


def _read(file: Path, wanted: Sequence[str]) -> dict[str, Array]:
    import scipy.io

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # scipy warns where it guesses
            data = scipy.io.loadmat(str(file), variable_names=list(wanted))
        raw = {name: np.asarray(data[name]).ravel() for name in wanted}
    except Exception as error:  # a damaged file makes scipy raise almost anything
        raise _broken(file, error) from error
    columns: dict[str, Array] = {}
    for name, values in raw.items():
        if values.dtype.kind not in "fiub":
            raise InputError(f"holds {values.dtype}, expected real numbers", file=file, place=name)
        columns[name] = np.ascontiguousarray(values, dtype=np.float64)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputError(f"its vectors differ in length: {listed}", file=file)
    return columns


def _broken(file: Path, error: BaseException) -> InputError:
    first = (str(error).splitlines() or [type(error).__name__])[0]
    return InputError(f"is not a readable MAT file: {first[:200]}", file=file)
