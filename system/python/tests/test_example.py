"""The example of README.md does what it says, with the robot in Rust and with the one in Python."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from hand_in_simulated_time import DEADLINE_S, MUJOCO, PROGRAM, RUST, TREE


class ExampleTest(unittest.TestCase):
    def session(self, description: Path, *, without: str = "") -> tuple[str, int]:
        """Runs the session; returns what it prints, and the bytes of its picture."""
        with tempfile.TemporaryDirectory() as place:
            picture = Path(place, "tracking.png")
            if without:
                Path(place, f"{without}.py").write_text(f"raise ImportError('{without}')\n")
            env = {**os.environ, "XDG_RUNTIME_DIR": place, "PYTHONPATH": place}
            try:
                run = subprocess.run(
                    [sys.executable, TREE / "system/python/examples/tracking.py", PROGRAM, description, picture],
                    env=env,
                    capture_output=True,
                    text=True,
                    timeout=DEADLINE_S,
                )
            except subprocess.TimeoutExpired:
                # The next tests need its files.
                subprocess.run([PROGRAM, "down"], env=env, check=False)
                raise
            self.assertEqual(run.returncode, 0, run.stdout + run.stderr)
            size = picture.stat().st_size if picture.exists() else 0
        self.assertEqual(len(re.findall(r"^\d \S+: running; ", run.stdout, re.MULTILINE)), 5)
        rms = [float(found) for found in re.findall(r"^ *\d+\.0 Hz: (\S+) deg rms$", run.stdout, re.MULTILINE)]
        # The stiffest controller of the three tracks best, and all track well.
        self.assertEqual((len(rms), min(rms)), (3, rms[2]))
        self.assertLess(max(rms), 0.1)
        self.assertIn("bandwidth_hz is 12.0 now, and was 10.0", run.stdout)
        found = re.search(r"^(\w+) has a fault; the least tension is 0\.0 N: (\w+)\.\w+-(?:flexor|extensor)\.effort$",
                          run.stdout, re.MULTILINE)
        assert found, run.stdout
        self.assertEqual(found[1], found[2])
        self.assertIn("mended: the motion is done", run.stdout)
        return run.stdout, size

    def test_a_session_with_the_robot_in_rust(self) -> None:
        shown, picture = self.session(RUST, without="matplotlib")
        self.assertEqual(picture, 0)
        curves = [line for line in shown.splitlines() if " |" in line]
        self.assertEqual(len(curves), 12)
        self.assertGreater(sum(line.count("3") for line in curves), 20)

    def test_a_session_with_the_robot_in_python(self) -> None:
        shown, picture = self.session(MUJOCO)
        self.assertIn("tracking.png shows it", shown)
        self.assertGreater(picture, 10_000)


if __name__ == "__main__":
    unittest.main()
