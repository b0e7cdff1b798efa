"""An exported model in FMPy's hands: compiled once a session for this computer, set, stepped and read by name."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

from workbench.core.run import Array
from workbench.export.fmu import FmiVersion, host, write_fmu
from workbench.export.model import Model


class Exported:
    """One .fmu file, unpacked; `instance()` gives as many instances as are wanted."""

    def __init__(self, model: Model, folder: Path, version: FmiVersion = "3.0") -> None:
        here = host()
        assert here is not None, "no target of the export is this computer"
        folder.mkdir(parents=True, exist_ok=True)
        self.model, self.version, self.file = model, version, folder / f"model{version[0]}.fmu"
        write_fmu(model, self.file, version, [here])
        self.folder = folder / f"unpacked{version[0]}"
        fmpy.extract(str(self.file), str(self.folder))
        self.description = fmpy.read_model_description(str(self.folder))
        self.reference = {v.name: v.valueReference for v in self.description.modelVariables}

    def instance(self, name: str = "one") -> Instance:
        return Instance(self, name)

    def remove(self) -> None:
        shutil.rmtree(self.folder)


class Instance:
    """A slave of FMPy with names instead of value references; `said`: what its logger was told."""

    def __init__(self, exported: Exported, name: str) -> None:
        self.exported, self.said = exported, []  # type: ignore[var-annotated]
        kind = FMU3Slave if exported.version == "3.0" else FMU2Slave
        self.slave: Any = kind(
            guid=exported.description.guid,
            unzipDirectory=str(exported.folder),
            modelIdentifier=exported.description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        if exported.version == "3.0":
            self.slave.instantiate(loggingOn=True, logMessage=self._listen3())
        else:
            self.slave.instantiate(loggingOn=True, callbacks=self._listen2())

    def _listen3(self) -> Callable[..., None]:
        def listen(environment: Any, status: int, category: bytes, message: bytes) -> None:
            self.said.append(message.decode())

        return listen

    def _listen2(self) -> Any:
        from ctypes import CFUNCTYPE, c_char_p, c_int, c_void_p

        from fmpy import fmi2

        callbacks = fmi2.fmi2CallbackFunctions()
        # The logger is variadic; what follows "%s" is the message.
        heard = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p, c_char_p)
        self._heard = heard(lambda environment, name, status, category, form, text: self.said.append(text.decode()))
        from ctypes import cast

        callbacks.logger = cast(self._heard, fmi2.fmi2CallbackLoggerTYPE)
        callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmi2.calloc)
        callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmi2.free)
        self._callbacks = callbacks
        return callbacks

    def start(self, values: Mapping[str, float] = {}, time_s: float = 0.0) -> Instance:
        """Through the initialization, with these parameters and inputs."""
        if self.exported.version == "3.0":
            self.set(values)
            self.slave.enterInitializationMode(startTime=time_s)
        else:
            self.slave.setupExperiment(startTime=time_s)
            self.set(values)
            self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()
        return self

    def set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            boolean = name in ("brake_closed", "motor_failed")
            if self.exported.version == "3.0":
                put = self.slave.setBoolean if boolean else self.slave.setFloat64
            else:
                put = self.slave.setBoolean if boolean else self.slave.setReal
            put([self.exported.reference[name]], [value])

    def get(self, *names: str) -> list[float]:
        references = [self.exported.reference[name] for name in names]
        read = self.slave.getFloat64 if self.exported.version == "3.0" else self.slave.getReal
        return list(read(references))

    def step(self, time_s: float, length_s: float) -> None:
        self.slave.doStep(currentCommunicationPoint=time_s, communicationStepSize=length_s)

    def close(self) -> None:
        self.slave.terminate()
        self.slave.freeInstance()

    def replay(self, time_s: Array, torque: Array, name: str, shown: Sequence[str]) -> Array:
        """Signals (n, shown) under an input given at samples, linear between them; the instance is started."""
        rows = np.empty((len(time_s), len(shown)))
        rows[0] = self.get(*shown)
        for k in range(len(time_s) - 1):
            length = float(time_s[k + 1] - time_s[k])
            slope = float(torque[k + 1] - torque[k]) / length
            if self.exported.version == "3.0":
                self.set({name: float(torque[k]), f"{name}_per_s": slope})
            else:
                self.set({name: float(torque[k])})
                self.slave.setRealInputDerivatives([self.exported.reference[name]], [1], [slope])
            self.step(float(time_s[k]), length)
            rows[k + 1] = self.get(*shown)
        return rows
