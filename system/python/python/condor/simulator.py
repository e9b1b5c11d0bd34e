"""A robot as a Python process: what is at the other side of the boards' registers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _condor
from .errors import NotFound, Refused


@dataclass(frozen=True)
class Parameter:
    """A parameter of a simulator: others read and set it while it runs, as they do parameters of loops."""

    value: float
    """The value at the beginning."""
    least: float
    greatest: float
    unit: str = ""
    about: str = ""
    """What it means, at most 128 bytes."""


@dataclass(frozen=True)
class Shown:
    """A variable of a simulator: others watch it."""

    unit: str = ""
    about: str = ""
    """What it means, at most 128 bytes."""


class Bus:
    """The bus of the boards, as the simulator of a robot has it: registers at addresses.

    All processors of a system that have boards map the same memory. An address at which nothing answers is an `Error`.
    """

    def __init__(self, inner: _condor.Simulator) -> None:
        self._inner = inner

    def read(self, address: int, count: int = 1, *, width: int = 2) -> npt.NDArray[np.uint32]:
        """Reads `count` registers of `width` bytes (1, 2 or 4) from `address` on; shape (count,)."""
        values = np.frombuffer(self._inner.read(address, width, count), f"<u{width}")
        return values.astype(np.uint32)

    def write(self, address: int, values: Union[int, npt.ArrayLike], *, width: int = 2) -> None:
        """Writes registers of `width` bytes (1, 2 or 4) from `address` on: the low bits of whole numbers."""
        array = np.atleast_1d(np.asarray(values))
        if array.dtype.kind not in "iub":
            raise Refused(f"registers are whole numbers, not {array.dtype}")
        self._inner.write(address, width, array.astype(f"<u{width}").tobytes())


class Simulator:
    """A robot, which is the program of a processor, and whose steps are in Python.

    The description of the system names the script as the program of a processor; the supervisor starts it, restarts it
    if it fails, and ends it. Make the simulator when all else is ready: from then on, the time of a system with a
    simulated clock waits for this process. One process makes one simulator.

        robot = condor.Simulator(2000, variables={"height": condor.Shown("m")})

        def step(now):
            force = robot.bus.read(0x1020)
            ...

        robot.run(step)

    In simulated time no time passes during a step, however long it computes, and a run with the same inputs gives the
    same results. On the real clock a step that comes too late is skipped, and counted.
    """

    def __init__(
        self,
        rate_hz: int,
        *,
        name: str = "robot",
        variables: Mapping[str, Shown] = {},
        parameters: Mapping[str, Parameter] = {},
    ) -> None:
        shown = [(of, it.unit, it.about) for of, it in variables.items()]
        tuned = [(of, it.unit, it.about, it.value, it.least, it.greatest) for of, it in parameters.items()]
        self._variables = {of: index for index, of in enumerate(variables)}
        self._parameters = {of: index for index, of in enumerate(parameters)}
        self._inner = _condor.Simulator(name, rate_hz, shown, tuned)
        self.rate_hz = rate_hz
        """The steps in a second, Hz."""
        self.bus = Bus(self._inner)
        """The bus of the boards."""

    @property
    def number(self) -> int:
        """The number of its processor."""
        return self._inner.number()

    def show(self, name: str, value: float) -> None:
        """Sets a variable of its own. Call it in a step."""
        if name not in self._variables:
            raise NotFound(f"the simulator has no variable `{name}`; it has {', '.join(self._variables) or 'none'}")
        self._inner.show(self._variables[name], value)

    def get(self, name: str) -> float:
        """Returns the value of a parameter in this step. Call it in a step."""
        value = self._inner.parameter(self._parameters.get(name, len(self._parameters)))
        if value is None:
            raise NotFound(f"the simulator has no parameter `{name}`; it has {', '.join(self._parameters) or 'none'}")
        return value

    def print(self, text: str) -> None:
        """Shows a line on the terminal of the processor."""
        self._inner.say(text)

    def run(self, step: Callable[[float], Any]) -> None:
        """Calls `step` with the time of the system, s, until the supervisor ends the program.

        An exception that `step` raises ends it, too, and is raised here.
        """
        self._inner.run(step)
