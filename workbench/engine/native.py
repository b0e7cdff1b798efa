"""Machine code of generated functions: compiled by numba once, afterwards loaded without it.

Importing numba and looking a function up in its own cache takes most of a second in
every new process. The generated functions need nothing of Python, so their object
code is kept as it is, and loading it takes milliseconds: numba is the compiler, and
llvmlite, its back end, the loader.

This relies on what numba does not promise: the names and the order of a function's
arguments in LLVM. `compile_function` compares both with what `_caller` passes, before
anything is called; `PROBE` is a function whose result is known. `numba_function` is the
way round: numba's own call path, which compiles in every process.

The types of a function's arguments are given by letters: `a` flat array of float64,
`f` float64, `i` int64; it returns an int64.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
import re
import threading
from collections.abc import Callable, Mapping
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
_loading = threading.Lock()
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

    with _loading:
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
