"""`condor.remote` without a robot; `cargo xtask remote` checks it with a gateway."""

from __future__ import annotations

import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import condor
from condor import remote

SCHEMA = """builtin_interfaces/Time time
uint64 tick # \tThe number of the tick.
uint32 lost # \tRows.
float32 index_proximal_position # index.proximal.position\trad\tMeasured.
uint8 KIND=3
bool ready # ready\t\t
float64 gain # index.gain\tHz\t
================================================================================
MSG: builtin_interfaces/Time
int32 sec
"""


class RemoteTest(unittest.TestCase):
    def test_rows_are_read_by_their_schema(self) -> None:
        fields = remote._fields_of(SCHEMA)
        names = [name for name, _ in fields]
        self.assertEqual(names, ["tick", "lost", "index.proximal.position", "ready", "index.gain"])
        message = b"\0\1\0\0" + struct.pack("<iIQIf?7xd", 3, 500_000_000, 7, 2, 0.5, True, 12.0)
        row = remote._decode(fields, message)
        expected = {"time": 3.5, "tick": 7, "lost": 2, "index.proximal.position": 0.5, "ready": True, "index.gain": 12.0}
        self.assertEqual(row, expected)

    def test_outcomes_say_what_is_certain(self) -> None:
        done = remote._outcome({"state": "done", "reason": "", "progress": None, "later": 1})
        self.assertTrue(done.is_done and done.is_final and not done.did_not_run)
        never = remote._outcome({"state": "never", "reason": "gone"})
        self.assertTrue(never.is_final and never.did_not_run)
        self.assertFalse(remote._outcome({"state": "accepted"}).is_final)

    def test_exceptions_are_those_of_the_package(self) -> None:
        self.assertTrue(issubclass(remote.Refused, condor.Refused) and issubclass(remote.NoAnswer, condor.TimedOut))
        self.assertTrue(remote.Refused("busy", True).again)
        with self.assertRaises(Exception) as raised:
            remote.Remote("hand", "lab", ["tcp/127.0.0.1:9"], timeout=0.2)
        self.assertIsInstance(raised.exception, condor.Error)

    def test_without_zenoh_it_says_what_to_install(self) -> None:
        with tempfile.TemporaryDirectory() as place:
            Path(place, "zenoh.py").write_text("raise ImportError('zenoh')\n")
            run = subprocess.run(
                [sys.executable, "-c", "import condor\nimport condor.remote"],
                env={"PYTHONPATH": place},
                capture_output=True,
                text=True,
            )
        self.assertIn("ImportError: condor.remote needs zenoh: pip install eclipse-zenoh", run.stderr)


if __name__ == "__main__":
    unittest.main()
