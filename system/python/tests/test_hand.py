"""The promises of the package about a hand without any processor."""

from __future__ import annotations

import unittest
from pathlib import Path

import condor
import numpy as np

CONFIGURATION = Path(__file__).resolve().parents[3] / "condor-hand" / "hands" / "utah-mit.toml"
MOTIONS = Path(__file__).resolve().parents[3] / "examples" / "utah-mit-hand" / "motions"
STEP = '[[motion]]\nprofile = "minimum-jerk"\nduration = 0.5\nto = { "thumb.middle" = 0.9 }\n'


class HandTest(unittest.TestCase):
    def setUp(self) -> None:
        self.hand = condor.Hand.read(CONFIGURATION)

    def test_joints_have_names_and_limits(self) -> None:
        self.assertEqual((self.hand.name, len(self.hand.joints), self.hand.limits.shape), ("utah-mit", 16, (16, 2)))
        self.assertEqual(self.hand.joints[1], "index.proximal")
        self.assertTrue((self.hand.limits[:, 0] < self.hand.limits[:, 1]).all())
        self.assertIn("index.tip", self.hand.urdf())

    def test_inverse_kinematics_leads_back(self) -> None:
        random = np.random.default_rng(7)
        low, high = self.hand.limits.T
        for _ in range(20):
            wanted = low + (high - low) * random.uniform(0.2, 0.8, len(low))
            poses = self.hand.forward(wanted)
            for frame in ["index.tip", "thumb.tip"]:
                np.testing.assert_allclose(poses[frame][:3, :3] @ poses[frame][:3, :3].T, np.eye(3), atol=1e-12)
                found = self.hand.inverse(frame, poses[frame][:3, 3], wanted * 0.9)
                self.assertTrue(found.is_reached, found)
                again = self.hand.forward(found.positions)[frame][:3, 3]
                np.testing.assert_allclose(again, poses[frame][:3, 3], atol=1e-6)
        far = self.hand.inverse("index.tip", [1.0, 0.0, 0.0])
        self.assertFalse(far.is_reached)
        self.assertGreater(far.distance, 0.5)

    def test_plans_are_those_of_the_generator(self) -> None:
        plan = self.hand.plan(STEP)
        ticks, column = len(plan.time), plan.column("thumb.middle")
        self.assertEqual(plan.position.shape, (ticks, 16))
        self.assertEqual(plan.position[-1, column], 0.9)
        # Velocity is the rate of the position; and a motion of minimum jerk is fastest in its middle.
        rate = np.gradient(plan.position[:, column], plan.time)
        np.testing.assert_allclose(rate[2:-2], plan.velocity[2:-2, column], atol=0.05)
        middle = plan.time[np.argmax(plan.velocity[:, column])]
        self.assertAlmostEqual(middle, 0.25, delta=0.03)
        self.assertAlmostEqual(plan.velocity[:, column].max(), 1.875 * (0.9 - plan.position[0, column]) / 0.5, delta=0.02)
        self.assertEqual([event.what for event in plan.events], ["begins", "reached"])
        self.assertEqual((plan.overloads, plan.collisions), ([], []))
        for file in sorted(MOTIONS.glob("*.toml")):
            self.assertGreater(len(self.hand.plan(file.read_text(), file=file.name).time), 10, file)
            self.assertEqual(self.hand.compile(file.read_text(), file=file.name)[:4], b"CNDM")

    def test_parts_have_clearances(self) -> None:
        parts = {frozenset(it.parts) for it in self.hand.clearances()}
        self.assertGreater(len(parts), 5)
        for one in self.hand.clearances():
            self.assertEqual(one.points.shape, (2, 3))

    def test_errors_say_what_is_wrong(self) -> None:
        for text, wrong in [
            ("mine.toml:2", lambda: condor.Hand.parse('name = "mine"\nservo_rate_hz = 400\n', file="mine.toml")),
            ("there is no joint 'thumb'", lambda: self.hand.forward({"thumb": 1.0})),
            ("utah-mit has 16 joints, the positions have the shape (3,)", lambda: self.hand.plan(STEP, [0.0] * 3)),
            ("a point has the shape (3,), not (2,)", lambda: self.hand.inverse("index.tip", [0.0, 1.0])),
            ("no.tip", lambda: self.hand.inverse("no.tip", [0.0, 0.0, 0.0])),
            ("nan", lambda: self.hand.inverse("index.tip", [np.nan, 0.0, 0.0])),
            ("step.toml:1", lambda: self.hand.plan("[[motion]\n", file="step.toml")),
            ("thumb.midle", lambda: self.hand.compile(STEP.replace("middle", "midle"))),
        ]:
            with self.assertRaises(condor.Refused) as raised:
                wrong()  # type: ignore[no-untyped-call]
            self.assertIn(text, str(raised.exception).lower() if text == "nan" else str(raised.exception))
        with self.assertRaises(condor.Error) as missing:
            condor.Hand.read("no-such-file.toml")
        self.assertEqual(str(missing.exception), "cannot read no-such-file.toml: No such file or directory")


if __name__ == "__main__":
    unittest.main()
