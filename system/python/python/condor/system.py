"""A running system, as a visitor sees it."""

from __future__ import annotations

import json
import numbers
import os
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Optional, Union

import numpy as np

from . import _condor
from .errors import Refused
from .hand import Hand
from .motions import Motion
from .samples import Samples, of_rows

Value = Union[bool, int, float, str]
"""The value of a variable: a label is a text."""

Given = Union[Value, np.number[Any], np.bool_]
"""A value that a parameter can be set to, also as numpy has it."""

_ANSWER_S = 2.0


def running() -> list[str]:
    """Returns the names of the running systems of this user, in alphabetical order."""
    return _condor.running()


def join(
    name: Optional[str] = None,
    *,
    directory: Union[str, os.PathLike[str], None] = None,
    timeout: float = 10.0,
) -> System:
    """Joins a running system as a visitor: that of a name, or in a directory; without both, the only one that runs.

    Use it as a context manager, or call `System.close`. Twelve visitors may look at a system at once.
    """
    if directory is not None:
        directory = os.fspath(directory)
    return System(_condor.System(name, directory, timeout))


@dataclass(frozen=True)
class Loop:
    """A servo loop of a processor."""

    name: str
    rate_hz: float
    """The rate that is set, Hz."""
    runs: int
    """The number of its runs."""
    overruns: int
    """The number of releases that were skipped."""
    worst_lateness_us: float
    """The longest time from a release to its start, µs."""
    worst_run_us: Optional[float]
    """Its longest run, µs; None in simulated time unless a time is declared."""
    enabled: bool
    faulted: bool


@dataclass(frozen=True)
class Vector:
    """A vector of a processor: a number for messages, and its handler."""

    vector: int
    name: str
    """The name of the handler; empty without one."""
    handled: int
    """The number of messages that were handled."""
    sent: int
    """The number of messages that the processor has sent to this vector of others."""
    failed: int
    """The number of messages that it has sent and that ended in an error."""


@dataclass(frozen=True)
class Processor:
    """A processor or a service of a system."""

    number: int
    name: str
    kind: str
    """`service`, `process`, or the word of another kind of processors."""
    state: str
    """`starting`, `running`, `stalled`, `failed`, `stopped` or `restarting`."""
    pid: Optional[int]
    """The process id of its program."""
    restarts: int
    """The number of restarts after failures."""
    last_exit: Optional[str]
    """How its program ended last."""
    mailbox: str
    """The state of its mailbox: `absent`, `joining`, `up` or `dead`."""
    incarnation: int
    """The incarnation of its mailbox, which changes each time a program joins."""
    loops: list[Loop]
    vectors: list[Vector]


@dataclass(frozen=True)
class Clock:
    """The simulated clock of a system."""

    seconds: float
    """The present instant, s."""
    speed: Optional[float]
    """The speed that is set, as a multiple of the real time; None means as fast as possible."""
    factor: float
    """The speed that was reached of late, simulated seconds per real second."""
    paused: bool
    waits_for: str
    """Why time does not go on at once, in words."""


@dataclass(frozen=True)
class Variable:
    """A variable or a parameter of a loop, or a field of a published cell."""

    name: str
    """The shortest name that no other has."""
    processor: str
    owner: str
    """Its loop or cell."""
    type: str
    """`f32`, `f64`, `i8` to `i64`, `u8` to `u64`, `bool` or `choice`."""
    unit: str
    about: str
    is_parameter: bool
    """Whether it can be set."""
    is_field: bool
    """Whether it is a field of a published cell."""
    bounds: Optional[tuple[Value, Value]]
    """The least and the greatest value of a parameter."""
    labels: list[str]
    """The labels of a choice."""


@dataclass(frozen=True)
class Published:
    """The latest value of a published cell: all fields of one instant."""

    sequence: int
    """Its sequence number."""
    fields: dict[str, Any]
    """The fields. Elements `name.0`, `name.1` and so on are one array of the shape (elements,)."""

    def __getitem__(self, name: str) -> Any:
        return self.fields[name]


class Watch:
    """Variables that are watched. A thread reads them whatever Python does; use it as a context manager."""

    def __init__(self, inner: _condor.Watch) -> None:
        self._inner = inner

    def read(self, rows: int = 0, *, seconds: float = 0.0, timeout: float = 10.0) -> Samples:
        """Waits until each loop has this many rows, which span this time; returns all rows since the last read.

        `seconds` is time of the system's clock, `timeout` is real time. Without `rows` and `seconds` it returns what
        there is. Raises `TimedOut` if there are too few rows; these stay for the next read.
        """
        if rows < 0:
            raise Refused(f"`rows` must be 0 or more, not {rows}")
        return of_rows(self._inner.read(rows, seconds, timeout))

    def changes(self) -> list[str]:
        """Returns what has happened to the watched programs since the last call, such as restarts, in words."""
        return self._inner.changes()

    def close(self) -> None:
        """Ends it, and gives the loops' slots back."""
        self._inner.close()

    def __enter__(self) -> Watch:
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()


class Terminal:
    """The terminal of a processor."""

    def __init__(self, inner: _condor.Terminal) -> None:
        self._inner = inner

    def write(self, text: str) -> None:
        """Types characters; `\\n` ends a line."""
        self._inner.write(text)

    def read_until(self, text: str, timeout: float = 10.0) -> str:
        """Waits until the terminal shows `text`; returns what it has shown since the last call, up to there.

        The first call begins with the end of what the terminal has shown before it was opened.
        """
        return self._inner.read_until(text, timeout)


class System:
    """A running system that this process has joined. `join` makes it."""

    def __init__(self, inner: _condor.System) -> None:
        self._inner = inner
        self._status = self._ask(do="status")
        # Takes it down, if this process has brought it up.
        self._ending: Optional[Callable[[], object]] = None

    def __enter__(self) -> System:
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leaves the system, and takes it down if `up` made this. Messages that nobody has taken yet are lost."""
        self._inner.close()
        if self._ending:
            self._ending()

    @property
    def name(self) -> str:
        """The name of the system."""
        return str(self._status["system"])

    @property
    def file(self) -> str:
        """The file of the description from which the system was started."""
        return str(self._status["file"])

    def _ask(self, timeout: float = 15.0, **request: Any) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._inner.request(json.dumps(request), timeout))
        return answer

    # Processors.

    def processors(self, *, services: bool = False, timeout: float = _ANSWER_S) -> list[Processor]:
        """Returns the state of all processors; with `services`, that of the host's services, too."""
        status = self._ask(timeout, do="status")
        members = status["processors"] + (status["services"] if services else [])
        return [self._processor(member, timeout) for member in members]

    def _processor(self, member: dict[str, Any], timeout: float) -> Processor:
        more = json.loads(self._inner.member(str(member["number"]), timeout))
        of_member = {key: member[key] for key in ("number", "name", "kind", "state", "pid", "restarts", "last_exit")}
        loops = [Loop(**{key: loop[key] for key in Loop.__dataclass_fields__}) for loop in more["loops"]]
        vectors = [Vector(**{key: one[key] for key in Vector.__dataclass_fields__}) for one in more["vectors"]]
        heart = more["heart"]
        return Processor(**of_member, mailbox=heart["presence"], incarnation=heart["incarnation"], loops=loops, vectors=vectors)

    def stop(self, processor: Union[str, int], *, timeout: float = 120.0) -> None:
        """Stops the program of a processor, or a service, and waits until it has ended."""
        self._ask(timeout, do="stop", processor=str(processor))

    def start(self, processor: Union[str, int], *, timeout: float = 120.0) -> None:
        """Starts the program of a processor, or a service, that does not run, and waits until it has joined."""
        self._ask(timeout, do="start", processor=str(processor))

    # Time.

    def now(self) -> float:
        """Returns the time on the clock of the system, s."""
        return self._inner.now(_ANSWER_S)

    def clock(self) -> Optional[Clock]:
        """Returns the state of the simulated clock; None if the system runs by the real one."""
        clock = self._ask(do="status").get("clock")
        return clock and Clock(**{key: clock[key] for key in Clock.__dataclass_fields__})

    def pause(self) -> None:
        """Pauses the simulated clock at the present instant."""
        self._ask(do="pause")

    def resume(self) -> None:
        """Lets the simulated clock go on."""
        self._ask(do="resume")

    def step(self, seconds: float) -> None:
        """Lets the simulated clock run for a time, and pauses it then; does not wait for that."""
        self._ask(do="step", ns=round(seconds * 1e9))

    def set_speed(self, speed: Optional[float]) -> None:
        """Sets the speed of the simulated clock, a multiple of the real time; None is as fast as possible."""
        self._ask(do="speed", thousandths=0 if speed is None else round(speed * 1000))

    # Messages.

    def send(
        self, processor: Union[str, int], vector: Union[str, int], data: int, *, timeout: float = _ANSWER_S
    ) -> None:
        """Sends a message of one word, 0 to 2³² - 1, to a vector of a processor or service; waits for no reply."""
        self._inner.send(str(processor), str(vector), _word(data), False, timeout)

    def call(
        self, processor: Union[str, int], vector: Union[str, int], data: int, *, timeout: float = _ANSWER_S
    ) -> int:
        """Sends a message of one word, 0 to 2³² - 1, and returns the reply, another one."""
        reply = self._inner.send(str(processor), str(vector), _word(data), True, timeout)
        assert reply is not None
        return reply

    # Variables and parameters.

    def variables(self, *patterns: str, timeout: float = _ANSWER_S) -> list[Variable]:
        """Returns variables, parameters and fields of these names and patterns; by default all of them.

        In a pattern, `*` stands for any characters, and `?` for one.
        """
        found = json.loads(self._inner.variables(list(patterns) or ["*"], timeout))
        for one in found:
            one["bounds"] = one["bounds"] and tuple(one["bounds"])
        return [Variable(**one) for one in found]

    def get(self, name: str, *, timeout: float = _ANSWER_S) -> Value:
        """Returns the present value of a variable, a parameter or a field.

        If several have the name, begin it with `processor:` or `processor:loop:`.
        """
        value = self._inner.get(name, timeout)
        if value is not None:
            return value
        with self.watch(name, timeout=timeout) as watch:
            (series,) = watch.read(1, timeout=timeout).values()
        last: Value = series.values[-1].item()
        return series.labels[int(last)] if last in range(len(series.labels)) else last

    def set(
        self, name: str, value: Given, *, expected: Optional[Given] = None, timeout: float = _ANSWER_S
    ) -> Value:
        """Sets a parameter, and returns the value that it had; a label is a text.

        With `expected`, it is set only if that is its present value. Raises `Refused` if the program refuses the
        value, with its bounds in the text.
        """
        before = None if expected is None else _text(expected)
        return self._inner.set(name, _text(value), before, timeout)

    def watch(
        self, *patterns: str, every: int = 1, capacity: int = 1_000_000, timeout: float = _ANSWER_S
    ) -> Watch:
        """Watches variables of these names and patterns: a row every `every` ticks of each loop that has some.

        Between two reads `capacity` rows of each loop are kept; what comes after them is counted as lost.
        """
        return Watch(self._inner.watch(list(patterns), every, capacity, timeout))

    def published(self, cell: str, *, timeout: float = _ANSWER_S) -> Published:
        """Returns the latest value of a published cell, `name` or `processor:name`."""
        sequence, values = self._inner.published(cell, timeout)
        fields: dict[str, Any] = {}
        for name, value in values:
            own, _, element = name.rpartition(".")
            if own and element.isdigit():
                fields.setdefault(own, []).append(value)
            else:
                fields[name] = value
        return Published(
            sequence, {name: np.array(it) if isinstance(it, list) else it for name, it in fields.items()}
        )

    def terminal(self, processor: Union[str, int], *, timeout: float = _ANSWER_S) -> Terminal:
        """Opens the terminal of a processor."""
        return Terminal(self._inner.terminal(str(processor), timeout))

    # Motions.

    def enqueue(self, motion: str, *, take_control: bool = False, timeout: float = 10.0) -> Motion:
        """Enqueues one of the robot's own motions by its name; it runs after those before it.

        If another client controls the robot, it is enqueued only with `take_control`. Control is given up as soon as
        the motion is accepted, which does not end it.
        """
        return self._enqueue(motion.encode(), take_control, timeout)

    def enqueue_text(
        self, motion: str, hand: Hand, *, file: str = "motion", take_control: bool = False, timeout: float = 10.0
    ) -> Motion:
        """Enqueues the text of a motion file, for the joints of `hand`; `file` is its name in errors."""
        return self._enqueue(hand.compile(motion, file=file), take_control, timeout)

    def _enqueue(self, motion: bytes, take_control: bool, timeout: float) -> Motion:
        return Motion(self._inner, self._inner.enqueue(motion, take_control, timeout))

    def cancel_motions(self, *, take_control: bool = False, timeout: float = 10.0) -> None:
        """Ends all motion of the robot, also what waits in the queue, and waits until it has ended."""
        self._inner.abort(take_control, timeout)

    def __repr__(self) -> str:
        return f"System({self.name!r})"


def _word(data: int) -> int:
    if not 0 <= data < 2**32:
        raise Refused(f"a message has a number from 0 to {2**32 - 1}, not {data}")
    return data


def _text(value: Given) -> str:
    """Writes a value as people write it for `condor vars set`."""
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, str):
        return value
    if isinstance(value, numbers.Integral):
        return str(int(value))
    return repr(float(value))
