"""Generated kernels as machine code: compiled by numba once, kept on disk, found again by what they say.

Importing numba and looking a function up in its own cache takes half a second of CPU in every new process (measured:
0.5 to 0.7 s a kernel against 0.04 s here), and numba does not say that arrays do not overlap, which costs a kernel of
eight lanes 2.7 times its time. The generated functions need nothing of Python, so their object code is kept as it is:
numba is the compiler, and llvmlite, its back end, the loader.

A kernel's file is named after the hash of its whole text, of the compiler's version and of the processor. The text
holds all physics, straight-line, so an edit of any equation gives another name and can never meet an old binary.

This relies on what numba does not promise: the names and the order of a function's arguments in LLVM.
`compile_function` compares both with what `_caller` passes, before anything is called; `PROBE` is a function whose
result is known, and each process loads and calls it first. Where the probe or a kernel does not come out as expected
(a numba that is newer than the tested ones), numba itself compiles and calls the functions, in every process anew.
WORKBENCH_ENGINE=numba asks for that, to compare or to get on.

The types of a function's arguments are given by letters: `a` flat array of float64, `f` float64, `i` int64; it returns
an int64.
"""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
import io
import itertools
import json
import logging
import os
import re
import stat
import tempfile
import threading
import zipfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

log = logging.getLogger(__name__)

TYPES = {"a": "float64[::1]", "f": "float64", "i": "int64"}
# What object code may call: the C library's mathematics and memory, found in any process.
OUTSIDE = {"sin", "cos", "exp", "sqrt", "floor", "memcpy", "memset", "memmove"}

# What LLVM calls numba's arguments, and their types: an array is seven of them (memory info, owner, number of
# elements, bytes of one, data, shape, strides).
_ARRAY = (("0", "ptr"), ("1", "ptr"), ("2", "i64"), ("3", "i64"), ("4", "ptr"), ("5.0", "i64"), ("6.0", "i64"))
_MEMBERS = {"a": _ARRAY, "f": (("", "double"),), "i": (("", "i64"),)}

PROBE = """
from numba import njit

@njit(nogil=True, error_model="numpy", _nrt=False)
def probe(a, x, n, b):
    for i in range(b.shape[0]):
        b[i] = a[i] * x + n + i
    return 100 * a.shape[0] + n
"""
PROBE_LETTERS = {"probe": "afia"}

_engines: list[Any] = []  # they own the loaded code, for the life of the process
_linking = threading.Lock()
_names = itertools.count()


class NotNativeError(RuntimeError):
    """numba or llvmlite do not behave as this module expects; `numba_function` still serves."""


def compile_function(function: Any, letters: str) -> bytes:
    """Object code of a function that numba has jitted without its runtime (`_nrt=False`).

    It defines one symbol, `entry`. NotNativeError where numba passes arguments in another way than `load_function`
    does, or where the code would call into Python or numba.
    """
    import llvmlite.binding as llvm

    function.compile(_signature(letters))
    (compiled,) = function.overloads.values()
    native = compiled.fndesc.llvm_func_name
    module = llvm.parse_assembly(_apart(compiled.library.get_llvm_str(), native))
    _check_convention(module.get_function(native), letters)
    # The library holds the wrappers for Python as well; without anyone who calls them they go.
    for item in itertools.chain(module.functions, module.global_variables):
        if not item.is_declaration:
            item.linkage = "external" if item.name == native else "internal"
    target = _target(llvm)
    options = llvm.PipelineTuningOptions(speed_level=3)
    options.loop_vectorization = True
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    missing = {f.name for f in module.functions if f.is_declaration and not f.name.startswith("llvm.")} - OUTSIDE
    if missing:
        raise NotNativeError(f"generated code calls {', '.join(sorted(missing))}, which is not free of Python")
    module.get_function(native).name = "entry"
    return bytes(target.emit_object(module))


def _signature(letters: str) -> str:
    return f"int64({', '.join(TYPES[letter] for letter in letters)})"


def _check_convention(function: Any, letters: str) -> None:
    """NotNativeError where a function's result or arguments are not those that `_caller` passes.

    Where `_apart` found no arrays to declare apart, the code is right and slower; that is logged.
    """
    types = [str(argument.type) for argument in function.arguments]
    names = [re.sub(r"^arg\.[A-Za-z_]\w*\.?", "arg.", argument.name) for argument in function.arguments]
    members = [member for letter in letters for member in _MEMBERS[letter]]
    known_types = ["ptr", "ptr", *(kind for _, kind in members)]
    known_names = ["retptr", "excinfo", *(f"arg.{name}" for name, _ in members)]
    result = str(function.global_value_type).partition("(")[0].strip()
    if (result, types, names) != ("i32", known_types, known_names):
        convention = ", ".join(f"{kind} {name}" for kind, name in zip(types, names, strict=True))
        raise NotNativeError(f"numba's calling convention is another one: {result} ({convention})")
    data = [argument for argument in function.arguments if re.fullmatch(r"arg\.\w+\.4", argument.name)]
    if not all(b"noalias" in argument.attributes for argument in data):
        log.warning("LLVM's text has changed: loops over lanes are not vectorised, and simulations take longer")


def _apart(text: str, name: str) -> str:
    """LLVM text with the arrays of function `name` declared not to overlap.

    numba does not say so, and LLVM then vectorises a loop over lanes only behind a check
    at run time, which it holds not worth while below 16 of them.
    """
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if line.startswith("define") and f"@{name}(" in line:
            lines[i] = re.sub(r"ptr ([^%]*)(%arg\.\w+\.4)\b", r"ptr noalias \1\2", line)
    return "\n".join(lines)


def load_function(code: bytes, letters: str) -> Callable[..., int]:
    """The function behind object code of `compile_function`, called with arrays and numbers.

    It lets go of the interpreter lock while it runs. Arrays are contiguous float64 and are
    neither copied nor checked here.
    """
    import llvmlite.binding as llvm

    with _linking:
        llvm.load_library_permanently("")  # the process itself: its C library
        empty = llvm.parse_assembly("")
        empty.name = f"kernel{next(_names)}"
        engine = llvm.create_mcjit_compiler(empty, _target(llvm))
        engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        engine.finalize_object()
        _engines.append(engine)
        address = engine.get_function_address("entry")
    return _caller(address, letters)


def _caller(address: int, letters: str) -> Callable[..., int]:
    """numba's calling convention: result, exception, then arrays as their seven members, numbers as they are."""
    members = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64, ctypes.c_void_p, ctypes.c_int64)
    kinds = {"a": (*members, ctypes.c_int64), "f": (ctypes.c_double,), "i": (ctypes.c_int64,)}
    flat = [kind for letter in letters for kind in kinds[letter]]
    function = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *flat)(address)

    def call(*arguments: Any) -> int:
        result, exception = ctypes.c_int64(0), ctypes.c_void_p(None)
        values: list[Any] = []
        for letter, argument in zip(letters, arguments, strict=True):
            if letter == "a":
                _check(argument)
                values += (None, None, argument.size, 8, argument.ctypes.data, argument.size, 8)
            else:
                values.append(float(argument) if letter == "f" else int(argument))
        status = function(ctypes.addressof(result), ctypes.addressof(exception), *values)
        if status != 0:
            raise RuntimeError(f"a kernel ended with status {status}")
        return result.value

    return call


def numba_function(function: Any, letters: str) -> Callable[..., int]:
    """The same function called by numba itself: right with any numba, and compiled in every process."""
    function.compile(_signature(letters))

    def call(*arguments: Any) -> int:
        values: list[Any] = []
        for letter, argument in zip(letters, arguments, strict=True):
            if letter == "a":
                _check(argument)
                values.append(argument)
            else:
                values.append(float(argument) if letter == "f" else int(argument))
        return int(function(*values))

    return call


def check_probe(probe: Callable[..., int]) -> None:
    """NotNativeError where the function of `PROBE` computes anything but what it says."""
    a, b = np.array([1.0, -2.0, 0.5]), np.zeros(2)
    returned = probe(a, 4.0, 7, b)
    if returned != 307 or b.tolist() != [11.0, 0.0] or a.tolist() != [1.0, -2.0, 0.5]:
        raise NotNativeError(f"a probe returned {returned} and {b.tolist()}, expected 307 and [11.0, 0.0]")


def _check(array: Any) -> None:
    if array.dtype != np.float64 or array.ndim != 1 or not array.flags.c_contiguous:
        raise TypeError(f"a kernel takes flat contiguous float64 arrays, not {array.dtype} of shape {array.shape}")


def host() -> Mapping[str, str]:
    """What object code depends on beside its text: the processor and the compiler."""
    from importlib.metadata import version

    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    return {"cpu": llvm.get_host_cpu_name(), "features": features, "triple": triple, "numba": version("numba")}


def _target(llvm: Any) -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        opt=3,
        jit=True,
        codemodel="jitdefault",
    )


_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_MOST_BYTES = 100_000_000
_loading = threading.Lock()  # two threads that want one kernel compile it once
_loaded: dict[str, dict[str, Callable[..., int]]] = {}
_said = False
_native: bool | None = None  # whether the probe came out right; None before it was tried
Functions = dict[str, Callable[..., int]]


def cache_folder() -> Path:
    """Where kernels are kept: WORKBENCH_CACHE, else the user's cache folder, else a temporary one.

    Kernels are code: a folder that somebody else owns or can write to is not used, whoever named it.
    """
    chosen = os.environ.get("WORKBENCH_CACHE")
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: a user without a home
        usual = os.environ.get("XDG_CACHE_HOME")
        base = Path(chosen) if chosen else (Path(usual) if usual else Path.home() / ".cache") / "workbench"
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        if _is_own(base):
            with tempfile.TemporaryFile(dir=base):
                return base
        _warn_of(base)
    return _fallback_folder()


def _is_own(folder: Path) -> bool:
    """Whether it is this user's alone to write to; a folder of theirs is made so."""
    if not hasattr(os, "getuid"):
        return True
    status = folder.stat()
    if status.st_uid != os.getuid():
        return False
    if status.st_mode & _OTHERS_WRITE:
        folder.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_WRITE)
    return not folder.stat().st_mode & _OTHERS_WRITE


@cache
def _warn_of(folder: Path) -> None:
    log.warning("%s belongs to another user: kernels are code, so they are kept in a temporary folder instead", folder)


@cache
def _fallback_folder() -> Path:
    """The user's own folder among the temporary ones; a new one where somebody else has taken its name."""
    owner = os.getuid() if hasattr(os, "getuid") else None
    folder = Path(tempfile.gettempdir()) / f"workbench-{'kernels' if owner is None else owner}"
    with contextlib.suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not folder.is_symlink() and _is_own(folder):
            with tempfile.TemporaryFile(dir=folder):
                return folder
    return Path(tempfile.mkdtemp(prefix="workbench-"))


def load_functions(text: str, letters: Mapping[str, str]) -> Functions:
    """The functions of a generated module that `letters` names, by their argument letters; see `native`.

    They come from the disk where they were compiled before, else they are compiled and
    kept there; on a full disk they are compiled and not kept. Where object code does not
    serve, numba calls them; a warning says why, and nothing is kept.
    """
    key = json.dumps([dict(letters), text], sort_keys=True)
    with _loading:
        if key not in _loaded:
            functions = _native_functions(text, letters) if _is_native() else None
            _loaded[key] = functions or _numba_functions(text, letters)
        return _loaded[key]


def _is_native() -> bool:
    """Whether object code serves in this process; tried once."""
    global _native
    if os.environ.get("WORKBENCH_ENGINE") == "numba":
        return False
    if _native is None:
        functions = _native_functions(PROBE, PROBE_LETTERS, ".probe")
        try:
            _native = functions is not None
            if functions:
                check_probe(functions["probe"])
        except RuntimeError as error:
            _native = False
            _warn(error)
    return _native


def _native_functions(text: str, letters: Mapping[str, str], suffix: str = ".kernel") -> Functions | None:
    """From object code; None, with a warning, where numba or llvmlite are not as `native` knows them."""
    try:
        path = cache_folder() / f"{_digest(text, letters)}{suffix}"
        codes = _read(path)
        if codes is None or codes.keys() != letters.keys():
            module = _module(text, quiet=suffix != ".kernel")
            codes = {name: compile_function(module[name], types) for name, types in letters.items()}
            _write(path, codes)
        return {name: load_function(codes[name], types) for name, types in letters.items()}
    except Exception as error:  # whatever a private interface does once it has changed
        _warn(error)
        return None


def _numba_functions(text: str, letters: Mapping[str, str]) -> Functions:
    module = _module(text)
    return {name: numba_function(module[name], types) for name, types in letters.items()}


def _warn(error: Exception) -> None:
    from importlib.metadata import version

    log.warning(
        "kernels cannot be kept as object code with numba %s and llvmlite %s (%s: %s); numba compiles them in every "
        "process instead: the results are the same, each start takes some seconds more",
        version("numba"), version("llvmlite"), type(error).__name__, error,
    )  # fmt: skip


def _digest(text: str, letters: Mapping[str, str]) -> str:
    key = json.dumps(["zip", dict(host()), dict(letters), text], sort_keys=True)  # the form of the file, too
    return hashlib.sha256(key.encode()).hexdigest()[:24]


def _module(text: str, quiet: bool = False) -> dict[str, Any]:
    """The names of a generated module, its functions not compiled yet."""
    global _said
    if not (_said or quiet):
        _said = True
        log.info("compiling the simulation for this computer (once; some seconds) ...")
    module: dict[str, Any] = {"__name__": "workbench_kernel"}
    exec(compile(text, "<generated kernel>", "exec"), module)
    return module


def _write(path: Path, codes: Mapping[str, bytes]) -> None:
    """The functions' codes as one file, whole or not at all."""
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file, zipfile.ZipFile(file, "w") as kept:
                for name, code in codes.items():
                    kept.writestr(zipfile.ZipInfo(name), code)  # without a date: the same codes are the same bytes
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


def _read(path: Path) -> dict[str, bytes] | None:
    """The codes in a file; None where it is not there, not whole (a full disk, a careless hand) or not one's own."""
    try:
        with zipfile.ZipFile(io.BytesIO(own_bytes(path))) as kept:
            return {name: kept.read(name) for name in kept.namelist()}
    except (OSError, zipfile.BadZipFile):
        return None


def own_bytes(path: Path) -> bytes:
    """A regular file of this user's. OSError for anything else; a pipe under that name is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    with os.fdopen(os.open(path, flags), "rb") as file:
        status = os.fstat(file.fileno())
        own = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & _OTHERS_WRITE)
        if not (own and stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES):
            raise PermissionError(path)
        return file.read()
