"""Generated kernels as machine code: compiled by numba once, kept on disk, found again by what they say.

Importing numba and looking a function up in its own cache takes half a second of CPU in every new process (measured:
0.5 to 0.7 s a kernel against 0.04 s here), and numba does not say that arrays do not overlap, which costs a kernel of
eight lanes 2.7 times its time. The generated functions need nothing of Python, so their object code is kept as it is:
numba is the compiler, and llvmlite, its back end, the loader.

A kernel's file is named after the hash of its whole text, of the compiler's version and of the processor. The text
holds all physics, straight-line, so an edit of any equation gives another name and can never meet an old binary.

This relies on what numba does not promise: the names, types and order of a function's arguments in LLVM.
`_check_convention` compares them with what `_load` passes before anything is called. Where they differ (a numba that is
newer than the tested ones), numba itself compiles and calls the functions, in every process anew.
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
FULL = "in lanes that fill the widest registers"  # said by a text whose loops take them: measured, narrower are slower
_MEMBERS = {"a": _ARRAY, "f": (("", "double"),), "i": (("", "i64"),)}
_CTYPES = {"ptr": ctypes.c_void_p, "i64": ctypes.c_int64, "double": ctypes.c_double}

Functions = dict[str, Callable[..., int]]
_engines: list[Any] = []  # they own the loaded code, for the life of the process
_loading = threading.Lock()  # two threads that want one kernel compile it once
_loaded: dict[str, Functions] = {}
_names = itertools.count()
_said: set[str] = set()


class NotNativeError(RuntimeError):
    """numba or llvmlite do not behave as this module expects; numba's own call still serves."""


def load_functions(text: str, letters: Mapping[str, str]) -> Functions:
    """The functions of a generated module that `letters` names, by their argument letters.

    They come from the disk where they were compiled before, else they are compiled and kept there; on a full disk they
    are compiled and not kept. Where object code does not serve, numba calls them; a warning says why, once.
    """
    key = json.dumps([dict(letters), text], sort_keys=True)
    with _loading:
        if key not in _loaded:
            _loaded[key] = _native_functions(text, letters) or {
                name: _called_by_numba(function, letters[name])
                for name, function in _module(text).items()
                if name in letters
            }
        return _loaded[key]


def _native_functions(text: str, letters: Mapping[str, str]) -> Functions | None:
    """From object code; None, with a warning, where numba or llvmlite are not as this module knows them."""
    if os.environ.get("WORKBENCH_ENGINE") == "numba":
        return None
    try:
        said = json.dumps(["zip", dict(host()), dict(letters), text], sort_keys=True)  # the form of the file, too
        path = cache_folder() / f"{hashlib.sha256(said.encode()).hexdigest()[:24]}.kernel"
        codes = kept = _read(path)
        if codes is None or codes.keys() != letters.keys():
            module = _module(text)
            codes = {name: _compiled(module[name], types, FULL in text) for name, types in letters.items()}
        functions = {name: _load(codes[name], types) for name, types in letters.items()}
        if codes is not kept:
            _write(path, codes)
        return functions
    except Exception as error:  # whatever a private interface does once it has changed
        from importlib.metadata import version

        _say(
            logging.WARNING,
            f"kernels cannot be kept as object code with numba {version('numba')} and llvmlite {version('llvmlite')} "
            f"({type(error).__name__}: {error}); numba compiles them in every process instead: the results are the "
            "same, each start takes some seconds more",
        )
        return None


def _say(level: int, sentence: str) -> None:
    """Once in a process."""
    first = sentence.partition(" with numba")[0]
    if first not in _said:
        _said.add(first)
        log.log(level, sentence)


def _module(text: str) -> dict[str, Any]:
    """The names of a generated module, its functions not compiled yet."""
    _say(logging.INFO, "compiling the simulation for this computer (once; some seconds) ...")
    module: dict[str, Any] = {"__name__": "workbench_kernel"}
    exec(compile(text, "<generated kernel>", "exec"), module)
    return module


def _compiled(function: Any, letters: str, full: bool = False) -> bytes:
    """Object code of a function that numba has jitted without its runtime (`_nrt=False`); its one symbol is `entry`.

    full: in the widest registers that there are. NotNativeError where numba passes arguments in another way than
    `_load` does, or where the code would call into Python or numba.
    """
    import llvmlite.binding as llvm
    from numba import config

    # Numba does not know that arrays lie apart, and would take narrow registers.
    usual, config.LOOP_VECTORIZE = config.LOOP_VECTORIZE, 0
    try:
        function.compile(_signature(letters))
    finally:
        config.LOOP_VECTORIZE = usual
    (compiled,) = function.overloads.values()
    native = compiled.fndesc.llvm_func_name
    module = llvm.parse_assembly(_apart(compiled.library.get_llvm_str(), native))
    _check_convention(module.get_function(native), letters)
    # The library holds the wrappers for Python as well; without anyone who calls them they go.
    for item in itertools.chain(module.functions, module.global_variables):
        if not item.is_declaration:
            item.linkage = "external" if item.name == native else "internal"
    target = _target(full)
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


def _apart(text: str, name: str) -> str:
    """LLVM text with the arrays of function `name` declared not to overlap.

    numba does not say so, and LLVM then vectorises a loop over lanes only behind a check at run time, if at all.
    """
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if line.startswith("define") and f"@{name}(" in line:
            lines[i] = re.sub(r"ptr ([^%]*)(%arg\.\w+\.4)\b", r"ptr noalias \1\2", line)
    return "\n".join(lines)


def _check_convention(function: Any, letters: str) -> None:
    """NotNativeError where a function's result or arguments are not those that `_load` passes.

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


def _load(code: bytes, letters: str) -> Callable[..., int]:
    """The function behind object code of `_compiled`, by numba's calling convention: result, exception, then arrays as
    their seven members, numbers as they are. It lets go of the interpreter lock while it runs."""
    import llvmlite.binding as llvm

    llvm.load_library_permanently("")  # the process itself: its C library
    empty = llvm.parse_assembly("")
    empty.name = f"kernel{next(_names)}"
    engine = llvm.create_mcjit_compiler(empty, _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    flat = [_CTYPES[kind] for letter in letters for _, kind in _MEMBERS[letter]]
    prototype = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_void_p, ctypes.c_void_p, *flat)
    function = prototype(engine.get_function_address("entry"))

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


def _called_by_numba(function: Any, letters: str) -> Callable[..., int]:
    """The same function called by numba itself: right with any numba, and compiled in every process."""
    function.compile(_signature(letters))

    def call(*arguments: Any) -> int:
        for letter, argument in zip(letters, arguments, strict=True):
            if letter == "a":
                _check(argument)
        return int(function(*arguments))

    return call


def _check(array: Any) -> None:
    if array.dtype != np.float64 or array.ndim != 1 or not array.flags.c_contiguous:
        raise TypeError(f"a kernel takes flat contiguous float64 arrays, not {array.dtype} of shape {array.shape}")


@cache
def host() -> Mapping[str, str]:
    """What object code depends on beside its text: the processor and the compiler."""
    from importlib.metadata import version

    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    triple = llvm.get_process_triple()
    return {"cpu": llvm.get_host_cpu_name(), "features": features, "triple": triple, "numba": version("numba")}


def _target(full: bool = False) -> Any:
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    if full and "+avx512f" in features:
        features += ",-prefer-256-bit"
    machine = llvm.Target.from_default_triple().create_target_machine
    return machine(cpu=cpu, features=features, opt=3, jit=True, codemodel="jitdefault")


_OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
_MOST_BYTES = 100_000_000


def cache_folder() -> Path:
    """Where kernels are kept: WORKBENCH_CACHE, else the user's cache folder, else a temporary one.

    Kernels are code: a folder that somebody else owns or can write to is not used, whoever named it.
    """
    chosen, usual = os.environ.get("WORKBENCH_CACHE"), os.environ.get("XDG_CACHE_HOME")
    with contextlib.suppress(OSError, RuntimeError):  # RuntimeError: a user without a home
        folder = Path(chosen) if chosen else (Path(usual) if usual else Path.home() / ".cache") / "workbench"
        if _serves(folder):
            return folder
        _say(logging.WARNING, f"{folder} belongs to another user: kernels are code, so they go to a temporary folder")
    return _fallback_folder()


@cache
def _fallback_folder() -> Path:
    """The user's own folder among the temporary ones; a new one where somebody else has taken its name."""
    owner = os.getuid() if hasattr(os, "getuid") else "kernels"
    folder = Path(tempfile.gettempdir()) / f"workbench-{owner}"
    with contextlib.suppress(OSError):
        if not folder.is_symlink() and _serves(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="workbench-"))


def _serves(folder: Path) -> bool:
    """Makes a folder; whether it is this user's alone to write to, after it was made so. OSError where none can be."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if hasattr(os, "getuid"):
        status = folder.stat()
        if status.st_uid != os.getuid():
            return False
        if status.st_mode & _OTHERS_WRITE:
            folder.chmod(stat.S_IMODE(status.st_mode) & ~_OTHERS_WRITE)
    with tempfile.TemporaryFile(dir=folder):
        return True


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
    """The codes in a file; None where it is not there, not whole (a full disk, a careless hand) or no regular file of
    this user's; a pipe under that name is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        with os.fdopen(os.open(path, flags), "rb") as file:
            status = os.fstat(file.fileno())
            own = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & _OTHERS_WRITE)
            if not (own and stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES):
                return None
            with zipfile.ZipFile(io.BytesIO(file.read())) as kept:
                return {name: kept.read(name) for name in kept.namelist()}
    except (OSError, zipfile.BadZipFile):
        return None
