"""Machine code of generated functions: made by numba once, afterwards loaded without it.

Importing numba and looking a function up in its own cache takes most of a second in
every new process. The functions made here need nothing of Python, so their object
code is kept as it is, and loading it takes milliseconds: numba is the compiler, and
llvmlite, its back end, the loader.

A function's arguments are told by letters: `a` flat array of float64, `f` float64,
`i` int64; it returns an int64.
"""

from __future__ import annotations

import ctypes
import itertools
import re
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

TYPES = {"a": "float64[::1]", "f": "float64", "i": "int64"}
# What object code may call: the C library's mathematics and memory, found in any process.
OUTSIDE = {"sin", "cos", "exp", "sqrt", "floor", "memcpy", "memset", "memmove"}

_engines: list[Any] = []  # they own the loaded code, for the life of the process
_loading = threading.Lock()
_names = itertools.count()


def compile_function(function: Any, letters: str) -> bytes:
    """Object code of a function that numba has jitted without its runtime (`_nrt=False`).

    It defines one symbol, `entry`. RuntimeError where the code would call into Python or numba.
    """
    import llvmlite.binding as llvm

    function.compile(f"int64({', '.join(TYPES[letter] for letter in letters)})")
    (compiled,) = function.overloads.values()
    native = compiled.fndesc.llvm_func_name
    module = llvm.parse_assembly(_apart(compiled.library.get_llvm_str(), native))
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
        raise RuntimeError(f"generated code calls {', '.join(sorted(missing))}, which is not free of Python")
    module.get_function(native).name = "entry"
    return bytes(target.emit_object(module))


def _apart(text: str, name: str) -> str:
    """LLVM text with the arrays of function `name` declared not to overlap.

    numba does not say so, and LLVM then vectorises a loop over lanes only behind a check
    at run time, which it holds not worth while below 16 of them.
    """
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if line.startswith("define") and f"@{name}(" in line:
            lines[i] = re.sub(r"ptr ([^,]*?)(%arg\.\w+\.4)\b", r"ptr noalias \1\2", line)
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
