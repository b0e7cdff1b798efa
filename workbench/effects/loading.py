"""Effects of users' files, loaded: the file is run, each effect is tried, and what passes is known by name.

A user's function is traced and compiled long after its file was read; what is wrong with it is said here, in one
sentence: can its plants take it, and is it off where it says so?
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from functools import cache
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from workbench.core.declared import declared_in
from workbench.core.errors import InputError
from workbench.core.run import Array
from workbench.effects.active import RUN_SYMBOLS, compiled
from workbench.effects.declare import Effect
from workbench.effects.registry import UserFile, add, read_user_file
from workbench.engine.source import parameter_symbols, state_symbols
from workbench.machines import PLANTS, Effects
from workbench.symbolic.expr import Expr, Scalar, Scalars, symbol

DRAWS = 20  # of states and parameters at which an effect has to vanish


def load_effects(path: str | os.PathLike[str]) -> tuple[Effect, ...]:
    """The effects that a Python file declares; from now on they are known by name in this process.

    InputError where the file is not there, fails, declares nothing, takes a name that is taken, or
    holds an effect that no plant can take. Loading the same file again replaces what it declared before.
    """
    return know(read_user_file(path), path)


def know(file: UserFile, shown: str | os.PathLike[str] | None = None) -> tuple[Effect, ...]:
    """Makes the effects of a file known, that was read here or elsewhere; see `load_effects`.

    shown: the path in errors, as the user wrote it.
    """
    try:
        effects = _declared(file)
    except InputError as error:
        raise InputError(error.problem, file=shown or file.path, line=error.line) from error
    add(effects, str(shown or file.path), file)
    return effects


@cache  # the same text again is the same effects, so kernels that were made for them serve on
def _declared(file: UserFile) -> tuple[Effect, ...]:
    """Runs the file; the effects that it declares itself. InputError with the line where it fails, where it declares
    nothing, and for an effect that no plant can take."""
    module = ModuleType(file.module)
    module.__file__ = file.path
    before = sys.modules.get(file.module)
    sys.modules[file.module] = module  # where dataclasses and the like look for it
    try:
        try:
            exec(compile(file.text, file.path, "exec", dont_inherit=True), vars(module))
        except (Exception, SystemExit) as error:
            problem = f"fails: {type(error).__name__}: {str(error) or 'without a word'}"
            raise InputError(problem.splitlines()[0], line=_line(error, file.path)) from error
        effects = tuple(e for e in declared_in(module, Effect) if e.function.__module__ == file.module)
        if not effects:
            raise InputError("declares no effect; see workbench.effects.effect")
        for effect in effects:
            for fault in faults(effect):
                raise InputError(f"effect {effect.id}: {fault}")
    except InputError:
        sys.modules.pop(file.module)
        if before is not None:
            sys.modules[file.module] = before
        raise
    return effects


def _line(error: BaseException, path: str) -> int | None:
    """The line of the file that an error comes from."""
    if isinstance(error, SyntaxError) and error.filename == path:
        return error.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return lines[-1] if lines else None


def faults(effect: Effect) -> list[str]:
    """What is wrong with an effect at work, in words; none where all is well."""
    sentences = []
    for kind in effect.kinds:
        try:
            problem = _on_sensor(effect) if effect.on_sensor else _in_plant(effect, kind)
        except AttributeError as error:
            problem = f"reads '{error.name}', which is not there{_known(effect, kind)}"
        except Exception as error:
            problem = f"{type(error).__name__}: {error}".splitlines()[0]
        if problem:
            sentences.append(f"on kind {kind}: {problem}")
    return sentences


def _known(effect: Effect, kind: str) -> str:
    if effect.on_sensor:
        return "; s has time_s and value"
    return f"; at {effect.place_on(kind)} s has {', '.join(_signals(effect, kind)) or 'nothing'}"


def _signals(effect: Effect, kind: str) -> Sequence[str]:
    """The names of what s holds at the effect's place."""
    seen: dict[str, None] = {}

    def spy(s: Any, p: Any) -> Scalar:
        seen.update(dict.fromkeys(vars(s)))
        return 0.0

    _rates(kind, Effects({effect.place_on(kind): [spy]}))
    return list(seen)


def _rates(kind: str, effects: Effects) -> Scalars:
    plant = PLANTS[kind]
    q, y = state_symbols(plant, effects)
    p = parameter_symbols((*plant.parameters, *effects.parameters))
    return plant.rates(symbol("t"), q, y, symbol("u"), p, effects)


def _in_plant(effect: Effect, kind: str) -> str:
    traced = _rates(kind, compiled(kind, (effect,)))
    if not all(isinstance(rate, Expr | float | int) for rate in traced):
        return "gives no number"
    signals, rng = _signals(effect, kind), np.random.default_rng(0)
    for _ in range(DRAWS):
        s = SimpleNamespace(**{name: float(rng.normal(scale=10.0)) for name in signals})
        p = SimpleNamespace(
            **{name: float(rng.uniform(0.1, 10.0)) for name in (*PLANTS[kind].parameters, *RUN_SYMBOLS)}
        )
        e = _vanished(effect)
        for memory in effect.memory:
            setattr(e, memory.symbol, float(memory.start(e, p)))
            if not float(memory.scale(e, p)) > 0.0:
                return "its memory's scale is not positive"
        for function in (effect.function, *effect.beside.values()):
            value = function(s, e, p)
            if value != 0.0:
                return f"gives {float(value):g} where its parameters vanish, expected exactly 0"
    return ""


def _on_sensor(effect: Effect) -> str:
    time = np.arange(100) * 0.01
    series = SimpleNamespace(time_s=time, value=np.sin(3.0 * time) + 2.0)
    assert effect.inverse is not None
    for what, function in (("it", effect.function), ("its inverse", effect.inverse)):
        shown: Array = np.asarray(function(series, _vanished(effect), SimpleNamespace()))
        if shown.shape != time.shape:
            return f"{what} gives an array of shape {shown.shape} for {len(time)} samples"
        if not np.array_equal(shown, series.value):
            return f"{what} changes the series where its parameters vanish"
    return ""


def _vanished(effect: Effect) -> SimpleNamespace:
    """e at the vanishing values, in units of the declaration; shapes at their starts."""
    return SimpleNamespace(
        **{
            parameter.symbol: parameter.start if parameter.vanishes_at is None else parameter.vanishes_at
            for parameter in effect.parameters
        }
    )
