"""The hand in simulated time, for the tests: `with Running() as system`."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Optional

import condor

TREE = Path(__file__).resolve().parents[3]
CONFIGURATION = TREE / "condor-hand" / "hands" / "utah-mit.toml"
PROGRAM = Path(os.environ.get("UTAH_MIT_HAND", TREE / "target" / "debug" / "utah-mit-hand"))
# The robot in Rust, and the one in Python.
RUST = TREE / "examples" / "utah-mit-hand" / "system.toml"
MUJOCO = TREE / "system" / "python" / "examples" / "mujoco_hand" / "system.toml"
# How long the hand may take to come up, s.
DEADLINE_S = 120


class Running:
    """The hand, from its start to its end, in a place of its own; joined, with all fingers enabled."""

    def __init__(self, description: Path = RUST) -> None:
        self._description = description
        self._place = tempfile.TemporaryDirectory()
        self._system: Optional[condor.System] = None
        os.environ["XDG_RUNTIME_DIR"] = self._place.name

    def __enter__(self) -> condor.System:
        try:
            self._system = condor.up(PROGRAM, self._description, arguments=["--speed", "max"], timeout=DEADLINE_S)
            # A system without a user types these lines itself: see `headless` in its description.
            self._system.terminal("master").read_until("(rms ", DEADLINE_S)
        except BaseException:
            self.__exit__()
            raise
        return self._system

    def __exit__(self, *_: object) -> None:
        if self._system:
            self._system.close()
        self._place.cleanup()
