"""Generated kernels as machine code: compiled once by LLVM, kept on disk, found again by what they say.

A kernel's text is straight-line Python on numbers between loops over lanes. It is written as LLVM's text here: a
general compiler of Python (numba) infers types and takes ten to twenty times as long for the same code.

A kernel's file is named after the hash of its whole text, of this module, of the compiler's version and of the
processor. The text holds all physics, straight-line, so an edit of any equation gives another name and can never meet
an old binary.

The types of a function's arguments are given by letters: `a` flat array of float64, `f` float64, `i` int64; it returns
an int64. Functions without letters take and give float64, and vanish in their callers. Arrays lie apart, indices and
divided whole numbers are not negative: the text keeps to that, and nothing checks it.
"""

from __future__ import annotations

import ast
import contextlib
import ctypes
import hashlib
import io
import itertools
import json
import logging
import os
import stat
import struct
import tempfile
import threading
import zipfile
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

log = logging.getLogger(__name__)

FULL = "in lanes that fill the widest registers"  # said by a text whose loops take them: measured, narrower are slower
_CTYPES = {"a": (ctypes.c_void_p, ctypes.c_int64), "f": (ctypes.c_double,), "i": (ctypes.c_int64,)}

# Of LLVM: what operators are on reals, and on whole numbers or truth values.
REAL, WHOLE, TRUTH = "double", "i64", "i1"
_ARITHMETIC: dict[type, tuple[str, str]] = {
    ast.Add: ("fadd", "add nsw"), ast.Sub: ("fsub", "sub nsw"), ast.Mult: ("fmul", "mul nsw"), ast.Div: ("fdiv", ""),
    ast.FloorDiv: ("", "sdiv"), ast.Mod: ("", "srem"), ast.BitAnd: ("", "and"), ast.BitOr: ("", "or"),
    ast.LShift: ("", "shl"), ast.And: ("", "and"), ast.Or: ("", "or"),
}  # fmt: skip
_COMPARED: dict[type, tuple[str, str]] = {
    ast.Lt: ("olt", "slt"), ast.LtE: ("ole", "sle"), ast.Gt: ("ogt", "sgt"), ast.GtE: ("oge", "sge"),
    ast.Eq: ("oeq", "eq"),
}  # fmt: skip
_CAST = {
    (WHOLE, REAL): "sitofp {0} {1} to double", (TRUTH, REAL): "uitofp {0} {1} to double",
    (REAL, TRUTH): "fcmp une double {1}, 0.0", (REAL, WHOLE): "fptosi double {1} to i64",
}  # fmt: skip
_INTRINSICS = {"abs": "fabs", "sqrt_": "sqrt", "floor_": "floor", "fma_": "fma"}

Functions = dict[str, Callable[..., int]]
_engines: list[Any] = []  # they own the loaded code, for the life of the process
_loading = threading.Lock()  # two threads that want one kernel compile it once
_loaded: dict[str, Functions] = {}
_names = itertools.count()
_said: set[str] = set()


def load_functions(text: str, letters: Mapping[str, str]) -> Functions:
    """The functions of a generated module that `letters` names, by their argument letters.

    They come from the disk where they were compiled before, else they are compiled and kept there; on a full disk they
    are compiled and not kept.
    """
    key = json.dumps([dict(letters), text], sort_keys=True)
    with _loading:
        if key not in _loaded:
            _loaded[key] = _functions(text, letters)
        return _loaded[key]


def _functions(text: str, letters: Mapping[str, str]) -> Functions:
    said = json.dumps([_own_text(), dict(host()), dict(letters), text], sort_keys=True)
    path = cache_folder() / f"{hashlib.sha256(said.encode()).hexdigest()[:24]}.kernel"
    code = _read(path)
    if code is None:
        _say(logging.INFO, "compiling the simulation for this computer (once; some seconds) ...")
        target = _target(FULL in text)
        code = bytes(target.emit_object(_optimised(text, letters, target)))
        _write(path, code)
    return _load(code, letters)


@cache
def _own_text() -> str:
    return Path(__file__).read_text(encoding="utf-8")


def _say(level: int, sentence: str) -> None:
    """Once in a process."""
    if sentence not in _said:
        _said.add(sentence)
        log.log(level, sentence)


def _optimised(text: str, letters: Mapping[str, str], target: Any) -> Any:
    import llvmlite.binding as llvm

    module = llvm.parse_assembly(_llvm(text, letters))
    options = llvm.PipelineTuningOptions(speed_level=3)
    options.loop_vectorization = True
    builder = llvm.create_pass_builder(target, options)
    builder.getModulePassManager().run(module, builder)
    return module


def _llvm(text: str, letters: Mapping[str, str]) -> str:
    """The text of a module, as LLVM's."""
    functions = [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    return "\n".join([
        *(f"declare double @llvm.{name}.f64({', '.join([REAL] * (1 + 2 * (name == 'fma')))})"
          for name in _INTRINSICS.values()),
        *(_Function(node, letters.get(node.name)).text for node in functions),
    ])  # fmt: skip


class _Function:
    """One function as LLVM's text.

    A variable is a place in memory, which LLVM turns into registers; one that is first a truth value and then a number,
    or the other way round, is two. Values are pairs of LLVM's type and name.
    """

    def __init__(self, node: ast.FunctionDef, letters: str | None) -> None:
        self._lines: list[str] = []
        self._types: dict[str, str] = {}  # of each variable, now
        self._places: dict[str, str] = {}  # name -> type
        self._ends: list[str] = []  # of the loops around
        self._names = itertools.count()
        result = REAL if letters is None else WHOLE
        self._result, arguments = result, list[str]()
        for argument, letter in zip(node.args.args, letters or "f" * len(node.args.args), strict=True):
            name = argument.arg
            if letter == "a":
                arguments += [f"ptr noalias %{name}", f"i64 %{name}.size"]
            else:
                kind = REAL if letter == "f" else WHOLE
                arguments.append(f"{kind} %{name}")
                self._keep(name, (kind, f"%{name}"))
        self._do(node.body)
        internal, inlined = ("internal ", "alwaysinline ") if letters is None else ("", "")
        places = [f"%{name} = alloca {kind}" for name, kind in self._places.items()]
        head = f"define {internal}{result} @{node.name}({', '.join(arguments)}) {inlined}nounwind {{"
        self.text = "\n".join([head, *places, *self._lines, "unreachable", "}"])

    def _put(self, line: str) -> None:
        self._lines.append(line)

    def _new(self, kind: str, what: str) -> tuple[str, str]:
        name = f"%.{next(self._names)}"
        self._put(f"{name} = {what}")
        return kind, name

    def _label(self) -> str:
        return f".{next(self._names)}"

    def _begin(self, label: str) -> None:
        self._put(f"{label}:")

    def _go(self, label: str) -> None:
        self._put(f"br label %{label}")

    def _as(self, kind: str, value: tuple[str, str]) -> str:
        """The name of a value in another type."""
        return value[1] if value[0] == kind else self._new(kind, _CAST[value[0], kind].format(*value))[1]

    def _keep(self, name: str, value: tuple[str, str]) -> None:
        kind = self._types.get(name, value[0])
        if {kind, value[0]} == {TRUTH, REAL}:
            kind = value[0]
        if (value[0], kind) == (REAL, WHOLE):
            raise TypeError(f"{name} is a whole number first, and then none")
        self._types[name] = self._places[f"{name}.{kind}"] = kind
        self._put(f"store {kind} {self._as(kind, value)}, ptr %{name}.{kind}")

    def _known(self, name: str) -> tuple[str, str]:
        kind = self._types[name]
        return self._new(kind, f"load {kind}, ptr %{name}.{kind}")

    def _element(self, array: str, index: ast.expr) -> str:
        _, at = self._value(index)
        return self._new("ptr", f"getelementptr inbounds double, ptr %{array}, i64 {at}")[1]

    def _combined(self, operator: object, a: tuple[str, str], b: tuple[str, str]) -> tuple[str, str]:
        real, whole = _ARITHMETIC[type(operator)]
        if whole and a[0] == b[0] != REAL:
            return self._new(a[0], f"{whole} {a[0]} {a[1]}, {b[1]}")
        return self._new(REAL, f"{real} double {self._as(REAL, a)}, {self._as(REAL, b)}")

    def _value(self, node: ast.expr) -> tuple[str, str]:
        match node:
            case ast.Constant(value=int(number)):
                return WHOLE, str(number)
            case ast.Constant(value=float(number)):
                return REAL, f"0x{struct.pack('>d', number).hex()}"
            case ast.Name(id=name):
                return self._known(name)
            case ast.Subscript(value=ast.Attribute(value=ast.Name(id=array))):  # array.shape[0]
                return WHOLE, f"%{array}.size"
            case ast.Subscript(value=ast.Name(id=array), slice=index):
                return self._new(REAL, f"load double, ptr {self._element(array, index)}")
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self._new(REAL, f"fneg double {self._as(REAL, self._value(operand))}")
            case ast.BinOp(left=left, op=operator, right=right) | ast.BoolOp(values=[left, right], op=operator) if (
                type(operator) in _ARITHMETIC
            ):
                return self._combined(operator, self._value(left), self._value(right))
            case ast.Compare(left=left, ops=[operator], comparators=[right]) if type(operator) in _COMPARED:
                a, b = self._value(left), self._value(right)
                real, whole = _COMPARED[type(operator)]
                if a[0] == b[0] == WHOLE:
                    return self._new(TRUTH, f"icmp {whole} i64 {a[1]}, {b[1]}")
                return self._new(TRUTH, f"fcmp {real} double {self._as(REAL, a)}, {self._as(REAL, b)}")
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._called(name, [self._value(argument) for argument in arguments])
        raise TypeError(f"no part of a kernel: {ast.unparse(node)}")

    def _called(self, name: str, values: Sequence[tuple[str, str]]) -> tuple[str, str]:
        if name == "int":
            return WHOLE, self._as(WHOLE, values[0])
        if name == "number":
            return self._new(REAL, f"bitcast i64 {values[0][1]} to double")
        if name == "select":
            flag, *values = self._as(TRUTH, values[0]), *values[1:]
        reals = [self._as(REAL, value) for value in values]
        if name == "bits":
            return self._new(WHOLE, f"bitcast double {reals[0]} to i64")
        if name == "max":  # as Python's: the first one, unless the second is greater
            _, flag = self._new(TRUTH, f"fcmp ogt double {reals[1]}, {reals[0]}")
            reals.reverse()
        if name in ("select", "max"):
            return self._new(REAL, f"select i1 {flag}, double {reals[0]}, double {reals[1]}")
        function = f"llvm.{_INTRINSICS[name]}.f64" if name in _INTRINSICS else name
        return self._new(REAL, f"call double @{function}({', '.join(f'double {real}' for real in reals)})")

    def _do(self, body: Sequence[ast.stmt]) -> None:
        for node in body:
            match node:
                case ast.Expr(value=ast.Constant()):  # a docstring
                    pass
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self._keep(name, self._value(value))
                case ast.Assign(targets=[ast.Subscript(value=ast.Name(id=array), slice=index)], value=value):
                    real = self._as(REAL, self._value(value))
                    self._put(f"store double {real}, ptr {self._element(array, index)}")
                case ast.AugAssign(target=ast.Name(id=name), op=operator, value=value):
                    self._keep(name, self._combined(operator, self._known(name), self._value(value)))
                case ast.Return(value=ast.expr() as value):
                    self._put(f"ret {self._result} {self._as(self._result, self._value(value))}")
                    self._begin(self._label())
                case ast.Break():
                    self._go(self._ends[-1])
                    self._begin(self._label())
                case ast.If(test=test, body=inner, orelse=[]):
                    then, after = self._label(), self._label()
                    self._put(f"br i1 {self._value(test)[1]}, label %{then}, label %{after}")
                    self._begin(then)
                    self._do(inner)
                    self._go(after)
                    self._begin(after)
                case ast.While(test=ast.Constant(value=True), body=inner):
                    self._loop(inner)
                case ast.For(target=ast.Name(id=name), iter=ast.Call(args=[count]), body=inner):
                    self._loop(inner, name, self._value(count)[1])
                case _:
                    raise TypeError(f"no part of a kernel: {ast.unparse(node)}")

    def _loop(self, body: Sequence[ast.stmt], name: str = "", count: str = "") -> None:
        """For ever, or with a variable from 0 to below count."""
        head, inner, after = self._label(), self._label(), self._label()
        following = f"{name}{head}"  # the variable's own value may be another one after the body
        if name:
            self._keep(following, (WHOLE, "0"))
        self._go(head)
        self._begin(head)
        if name:
            now = self._known(following)
            self._put(f"br i1 {self._new(TRUTH, f'icmp slt i64 {now[1]}, {count}')[1]}, label %{inner}, label %{after}")
            self._begin(inner)
            self._keep(name, now)
            self._keep(following, self._new(WHOLE, f"add nsw i64 {now[1]}, 1"))
        self._ends.append(after)
        self._do(body)
        self._ends.pop()
        self._go(head)
        self._begin(after)


def _load(code: bytes, letters: Mapping[str, str]) -> Functions:
    """The functions behind object code. They let go of the interpreter lock while they run."""
    import llvmlite.binding as llvm

    llvm.load_library_permanently("")  # the process itself: its C library
    empty = llvm.parse_assembly("")
    empty.name = f"kernel{next(_names)}"
    engine = llvm.create_mcjit_compiler(empty, _target())
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    return {name: _callable(engine.get_function_address(name), types) for name, types in letters.items()}


def _callable(address: int, letters: str) -> Callable[..., int]:
    prototype = ctypes.CFUNCTYPE(ctypes.c_int64, *(kind for letter in letters for kind in _CTYPES[letter]))
    function = prototype(address)

    def call(*arguments: Any) -> int:
        values: list[Any] = []
        for letter, argument in zip(letters, arguments, strict=True):
            if letter == "a":
                _check(argument)
                values += (argument.ctypes.data, argument.size)
            else:
                values.append(float(argument) if letter == "f" else int(argument))
        return int(function(*values))

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
    return {"cpu": llvm.get_host_cpu_name(), "features": features, "triple": triple, "llvmlite": version("llvmlite")}


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


def _write(path: Path, code: bytes) -> None:
    """A file with a kernel's code, whole or not at all."""
    with contextlib.suppress(OSError):
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".tmp")
        try:
            with os.fdopen(handle, "wb") as file, zipfile.ZipFile(file, "w") as kept:
                kept.writestr(zipfile.ZipInfo("code"), code)  # without a date: the same code is the same bytes
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(temporary)
            raise


def _read(path: Path) -> bytes | None:
    """The code in a file; None where it is not there, not whole (a full disk, a careless hand) or no regular file of
    this user's; a pipe under that name is not waited for."""
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
    try:
        with os.fdopen(os.open(path, flags), "rb") as file:
            status = os.fstat(file.fileno())
            own = not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & _OTHERS_WRITE)
            if not (own and stat.S_ISREG(status.st_mode) and status.st_size <= _MOST_BYTES):
                return None
            with zipfile.ZipFile(io.BytesIO(file.read())) as kept:
                return kept.read("code")
    except (OSError, KeyError, zipfile.BadZipFile):
        return None
