"""The hand in simulated time, for the tests: `with Running(program) as system`."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from pathlib import Path

import condor

TREE = Path(__file__).resolve().parents[2]
CONFIGURATION = TREE / "condor-hand" / "hands" / "utah-mit.toml"
PROGRAM = Path(os.environ.get("UTAH_MIT_HAND", TREE / "target" / "debug" / "utah-mit-hand"))
# How long the hand may take to come up, s.
DEADLINE_S = 120


class Running:
    """The hand, from its start to its end, in a place of its own; joined, with all fingers enabled."""

    def __init__(self, speed: str = "max") -> None:
        self._place = tempfile.TemporaryDirectory()
        os.environ["XDG_RUNTIME_DIR"] = self._place.name
        command = [str(PROGRAM), "up", "--headless", "--speed", speed]
        self._program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def __enter__(self) -> condor.System:
        try:
            self.system = self._joined()
            # A system without a user types these lines itself: see `headless` in its description.
            self.system.terminal("master").read_until("rms is", DEADLINE_S)
        except BaseException:
            self._end()
            raise
        return self.system

    def _joined(self) -> condor.System:
        end = time.monotonic() + DEADLINE_S
        while True:
            try:
                system = condor.join(timeout=DEADLINE_S)
                system.variables("index.proximal.bandwidth_hz", "thumb.distal.position")
                return system
            except condor.Error:
                if time.monotonic() > end or self._program.poll() is not None:
                    raise
                time.sleep(0.05)

    def __exit__(self, *_: object) -> None:
        self.system.close()
        self._end()

    def _end(self) -> None:
        self._program.send_signal(signal.SIGTERM)
        self._program.wait(DEADLINE_S)
        self._place.cleanup()
