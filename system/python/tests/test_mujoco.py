"""The hand as a model of MuJoCo, in a Python process, tracks as the simulated robot in Rust does."""

from __future__ import annotations

import time
import unittest

import condor
import numpy as np
import numpy.typing as npt
from hand_in_simulated_time import CONFIGURATION, DEADLINE_S, MUJOCO, RUST, Running

Array = npt.NDArray[np.float64]

# What 12 bits make of a position, rad: positions in rows are whole numbers of it.
COUNT_RAD = 7.7e-4
# The same controllers get the same set-points to the last bit, so only the robots differ. The model of MuJoCo takes one
# Euler step of 0.5 ms where the robot in Rust takes five, with exact actuators: up to 8e-4 rad over a motion, one count.
# Where a position lies at the edge of a count, rounding adds one.
POSITION_RAD = 2.5 * COUNT_RAD
# Such a difference lasts for a few ticks: in the mean over the motion, where errors are some 5e-4 rad, little is left.
RMS_RAD = 1e-4
# A set-point of the motion goes this far in a tick, rad. Before that it may change by less, when its joint begins to
# follow.
STEP_RAD = 1e-5


def moved(system: condor.System, joints: list[str]) -> tuple[Array, Array]:
    """Runs a motion; returns set-points and positions of joints, from its first tick on: of the shape (rows, joints)."""
    with system.watch(*(f"{joint}.{what}" for joint in joints for what in ("target", "position"))) as watch:
        watch.read(1, timeout=DEADLINE_S)
        outcome = system.enqueue("wave", timeout=DEADLINE_S).wait(DEADLINE_S)
        assert outcome.is_done, outcome
        # Both servo processors have come to rest.
        samples = watch.read(40, timeout=DEADLINE_S)
    assert samples.lost == {"servo-a:servo": 0, "servo-b:servo": 0}, samples.lost
    columns: list[list[Array]] = [[], []]
    for servo in ("servo-a:servo", "servo-b:servo"):
        own = [joint for joint in joints if samples[f"{joint}.target"].source == servo]
        target, position = (samples.matrix([f"{joint}.{what}" for joint in own]) for what in ("target", "position"))
        first = int(np.flatnonzero(np.any(np.abs(np.diff(target, axis=0)) > STEP_RAD, axis=1))[0])
        columns[0].extend(target[first : first + 1300].T)
        columns[1].extend(position[first : first + 1300].T)
    target, position = (np.column_stack(of) for of in columns)
    return target, position


class MujocoTest(unittest.TestCase):
    def test_it_tracks_as_the_robot_in_rust(self) -> None:
        joints = condor.Hand.read(CONFIGURATION).joints
        with Running(RUST) as system:
            target, position = moved(system, joints)
        with Running(MUJOCO) as system:
            same_target, other = moved(system, joints)
            self.restarts(system)
        self.assertEqual(target.shape, (1300, 16))
        self.assertGreater(np.ptp(target, axis=0).max(), 0.9)
        np.testing.assert_array_equal(target, same_target)
        # It is another robot: were it the same, they would agree to the last bit.
        self.assertGreater(np.abs(position - other).max(), 0.0)
        self.assertLess(np.abs(position - other).max(), POSITION_RAD)
        errors = [target - position, target - other]
        rms, other_rms = (np.sqrt(np.mean(error**2, axis=0)) for error in errors)
        peak, other_peak = (np.abs(error).max(axis=0) for error in errors)
        for column, joint in enumerate(joints):
            print(
                f"{joint:16} rms {rms[column] * 1e3:.3f} and {other_rms[column] * 1e3:.3f} mrad,"
                f" peak {peak[column] * 1e3:.2f} and {other_peak[column] * 1e3:.2f} mrad"
            )
        self.assertLess(np.abs(rms - other_rms).max(), RMS_RAD)

    def restarts(self, system: condor.System) -> None:
        """The robot in Python ends and begins anew, and the hand goes on with it."""
        terminal = system.terminal("master")
        system.stop("plant")
        system.start("plant")
        self.assertIn("in MuJoCo", system.terminal("plant").read_until("Hz", DEADLINE_S))
        # The joints have jumped to where the new robot begins, which is a fault of fingers: a person enables them.
        end = time.monotonic() + DEADLINE_S
        outcome = None
        while not (outcome and outcome.is_done):
            self.assertLess(time.monotonic(), end, outcome)
            terminal.write("enable\n")
            try:
                outcome = system.enqueue("open", take_control=True, timeout=DEADLINE_S).wait(DEADLINE_S)
            except condor.Refused:
                # Not all fingers are ready.
                pass


if __name__ == "__main__":
    unittest.main()
