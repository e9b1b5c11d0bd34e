"""The example of README.md does what it says."""

from __future__ import annotations

import subprocess
import sys
import unittest

from hand_in_simulated_time import DEADLINE_S, TREE, Running


class ExampleTest(unittest.TestCase):
    def test_a_gain_is_tuned_and_a_fault_is_found(self) -> None:
        with Running():
            example = [sys.executable, "condor-py/examples/tracking.py"]
            run = subprocess.run(example, cwd=TREE, capture_output=True, text=True, timeout=DEADLINE_S)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("ring.fault is set; the least tension is ", run.stdout)


if __name__ == "__main__":
    unittest.main()
