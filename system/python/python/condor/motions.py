"""Motions that a robot was asked for."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Optional

from . import _condor
from .errors import TimedOut

_PAUSE_S = 0.02


@dataclass(frozen=True)
class Outcome:
    """What has become of a motion."""

    state: str
    """`accepted`, `started`, `done`, `stopped`, `aborted`, `refused`, `lost`, `broken-off`, `forgotten`, `unknown`."""
    reason: Optional[str]
    """Why it is refused or has ended early."""
    progress: Optional[float]
    """How much of it is done, 0 to 1, while it runs; None if nobody knows."""
    before: int
    """The number of motions that run or wait before it."""
    is_final: bool
    """Whether nothing changes any more."""

    @property
    def is_done(self) -> bool:
        """Whether it has reached its end."""
        return self.state == "done"


class Motion:
    """A motion in the queue of a robot. It runs at most once, whatever becomes of this object."""

    def __init__(self, system: _condor.System, ticket: tuple[int, int]) -> None:
        self._system = system
        self._ticket = ticket

    @property
    def identity(self) -> tuple[int, int]:
        """The session and the number of the motion there."""
        return self._ticket

    def outcome(self, timeout: float = 5.0) -> Outcome:
        """Returns what has become of it by now."""
        return Outcome(*self._system.outcome(self._ticket, timeout))

    def wait(self, timeout: float = 60.0) -> Outcome:
        """Waits until nothing changes any more, for `timeout` seconds at most; returns what has become of it.

        Raises `TimedOut` if it has not ended by then. It goes on all the same.
        """
        end = time.monotonic() + timeout
        while True:
            outcome = self.outcome(min(max(end - time.monotonic(), 0.1), 5.0))
            if outcome.is_final:
                return outcome
            if time.monotonic() >= end:
                raise TimedOut(f"the motion has not ended within {timeout} s; it is {outcome.state}")
            time.sleep(_PAUSE_S)

    def __repr__(self) -> str:
        return f"Motion(session {self._ticket[0]}, number {self._ticket[1]})"
