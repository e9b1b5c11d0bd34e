"""Bringing a system up, for notebooks and tests."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
import weakref
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Optional, Union

from .errors import Error, TimedOut
from .system import Processor, System, join, running

_LOOK_S = 0.05
_END_S = 30.0
# Of what the supervisor has said, if it has ended.
_LINES = 20


def up(
    program: Union[str, os.PathLike[str]] = "condor",
    description: Union[str, os.PathLike[str], None] = None,
    *,
    arguments: Sequence[str] = (),
    timeout: float = 60.0,
) -> System:
    """Brings a system up, waits until all of its programs run, and joins it.

    `program` is `condor`, or a binary that has it with programs of its own. `description` is the file of the system's
    description, by default that of the program. `arguments` are those of `condor up`, such as `["--speed", "max"]`; the
    lines under `headless` of the description are typed. Robots in Python run in the virtual environment of this process.
    `System.close`, or the end of this process, takes it down.
    """
    words = [os.fspath(program), "up", "--headless", *arguments]
    if description is not None:
        words.insert(2, os.fspath(description))
    before = set(running())
    with tempfile.TemporaryFile() as said:
        try:
            process = subprocess.Popen(
                words, env=_environment(), stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said
            )
        except OSError as error:
            raise Error(f"cannot start {words[0]}: {error.strerror}") from error
        try:
            system = _joined(process, before, description, said, time.monotonic() + timeout)
        except BaseException:
            _end(process)
            raise
    system._ending = weakref.finalize(system, _end, process)
    return system


def _environment() -> dict[str, str]:
    """Returns the environment in which scripts find the Python of this process, if that is in a virtual environment."""
    environment = dict(os.environ)
    if sys.prefix != sys.base_prefix:
        environment["PATH"] = f"{sys.prefix}/bin{os.pathsep}{environment.get('PATH', os.defpath)}"
    return environment


def _joined(
    process: subprocess.Popen[bytes],
    before: set[str],
    description: Union[str, os.PathLike[str], None],
    said: IO[bytes],
    end: float,
) -> System:
    """Joins the system that `process` brings up."""
    system: Optional[System] = None
    while True:
        if process.poll() is not None:
            said.seek(0)
            lines = said.read().decode(errors="replace").strip().splitlines()
            raise Error("\n".join(lines[-_LINES:]) or f"the supervisor has ended with status {process.returncode}")
        try:
            system = system or _new(before, description)
            if system and all(map(_has_begun, system.processors(services=True))):
                return system
        except Error:
            # It is not whole yet, or ends.
            pass
        if time.monotonic() > end:
            raise TimedOut(f"{process.args!r} has not brought up its system in time")
        time.sleep(_LOOK_S)


def _has_begun(one: Processor) -> bool:
    """Whether a program runs, or has run and ended: when a system does not come up, programs are stopped before."""
    return one.state in ("running", "held", "stalled") or (one.state != "starting" and one.last_exit is not None)


def _new(before: set[str], description: Union[str, os.PathLike[str], None]) -> Optional[System]:
    """Joins the system that has not been there before and is of this description."""
    for name in set(running()) - before:
        system = join(name)
        if description is None or Path(system.file).resolve() == Path(description).resolve():
            return system
        system.close()
    return None


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
