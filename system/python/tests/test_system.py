"""The promises of the package about a running system, kept by the hand in simulated time."""

from __future__ import annotations

import threading
import unittest
from collections.abc import Callable
from typing import Any

import condor
import numpy as np
from hand_in_simulated_time import CONFIGURATION, DEADLINE_S, Running

JOINT = "index.proximal"
GAIN = f"{JOINT}.servo.bandwidth_hz"
STEP = """[[motion]]
profile = "minimum-jerk"
duration = 0.5
to = { "index.proximal" = 0.9 }
[[motion]]
profile = "minimum-jerk"
duration = 0.5
to = { "index.proximal" = 0.7 }
"""


class SystemTest(unittest.TestCase):
    """One hand serves all tests, in the order of their names: the last one breaks a tendon."""

    running: Running
    system: condor.System
    hand: condor.Hand

    @classmethod
    def setUpClass(cls) -> None:
        cls.running = Running()
        cls.system = cls.running.__enter__()
        cls.hand = condor.Hand.read(CONFIGURATION)

    @classmethod
    def tearDownClass(cls) -> None:
        cls.running.__exit__()

    def refused(
        self, kind: type[BaseException], text: str, call: Callable[..., object], *arguments: Any, **options: Any
    ) -> None:
        with self.assertRaises(kind) as raised:
            call(*arguments, **options)
        self.assertIn(text, str(raised.exception))
        self.assertIsInstance(raised.exception, condor.Error)

    def paused(self) -> bool:
        clock = self.system.clock()
        assert clock is not None
        return clock.paused

    def test_processors_have_state_loops_and_vectors(self) -> None:
        self.assertEqual(condor.running(), [self.system.name])
        processors = {it.name: it for it in self.system.processors(services=True)}
        self.assertLessEqual({"plant", "servo-a", "servo-b", "table", "master", "files", "terminals"}, set(processors))
        servo = processors["servo-a"]
        self.assertEqual((servo.number, servo.state, servo.mailbox, servo.restarts), (1, "running", "up", 0))
        (loop,) = servo.loops
        self.assertEqual((loop.name, loop.rate_hz, loop.enabled, loop.faulted), ("servo", 400.0, True, False))
        self.assertGreater(loop.runs, 400)
        self.assertIn("servos", [vector.name for vector in servo.vectors])
        self.assertFalse(self.paused())
        self.assertGreater(self.system.now(), 1.0)

    def test_errors_say_what_is_wrong(self) -> None:
        system = self.system
        self.refused(LookupError, "no system `nobody` is running; there are utah-mit-hand", condor.join, "nobody")
        self.refused(LookupError, "there is no variable or parameter `index.proximal.bandwith_hz`; of ",
                     system.get, "index.proximal.bandwith_hz")
        self.refused(LookupError, "no variable or parameter matches `nothing*`", system.watch, "nothing*")
        self.refused(LookupError, "there is no published cell `lies`; there are ", system.published, "lies")
        self.refused(LookupError, "there is no processor `servo-x`; there are ", system.call, "servo-x", 1, 0)
        self.refused(LookupError, "servo-a has no vector `servo`: name one of ", system.call, "servo-a", "servo", 0)
        self.refused(LookupError, "has no handler for", system.call, "servo-a", 9, 0)
        self.refused(ValueError, "a message has a number from 0 to 4294967295, not -1", system.send, 1, 42, -1)
        self.refused(ValueError, "`timeout` must be a number of seconds, 0 or more, not -1", system.get, GAIN, timeout=-1)
        self.refused(ValueError, "`every` and `capacity` must be 1 or more, not 0 ", system.watch, GAIN, every=0)
        # It is refused when its turn comes, which is at once if nothing else moves the robot.
        try:
            reason = system.enqueue("wafe").wait(DEADLINE_S).reason
        except condor.Refused as error:
            reason = str(error)
        self.assertIn("no such motion", str(reason))

    def test_gains_are_read_and_set(self) -> None:
        system = self.system
        before = system.get(GAIN)
        self.assertEqual(system.set(GAIN, 12), before)
        self.assertEqual(system.get(GAIN), 12.0)
        self.assertEqual(system.set(GAIN, np.float32(before), expected=12.0), 12.0)
        self.refused(ValueError, f"`{GAIN}` must be from 0.0 to 50.0 Hz, not -1.0", system.set, GAIN, -1)
        self.refused(ValueError, f"`{GAIN}` was not set: its present value is {before!r}",
                     system.set, GAIN, 5.0, expected=1.0)
        self.refused(ValueError, "`stiff` is not a value of type f64", system.set, GAIN, "stiff")
        self.refused(ValueError, "is not a parameter and cannot be set", system.set, f"{JOINT}.position", 1.0)
        self.assertEqual(system.get(GAIN), before)
        self.assertEqual(system.set(f"{JOINT}.servo.law", "pd"), "decoupled")
        self.refused(ValueError, "`mpc` is not one of pd, decoupled", system.set, f"{JOINT}.servo.law", "mpc")
        self.assertEqual(system.set(f"{JOINT}.servo.law", "decoupled"), "pd")
        (gain,) = system.variables(GAIN)
        self.assertEqual((gain.processor, gain.owner, gain.unit, gain.bounds), ("servo-a", "servo", "Hz", (0.0, 50.0)))
        self.assertTrue(gain.is_parameter)

    def test_cells_are_read_as_a_whole(self) -> None:
        one, other = self.system.published("truth"), self.system.published("plant:truth")
        self.assertGreaterEqual(other.sequence, one.sequence)
        self.assertEqual((one["position"].shape, one["effort"].shape, one["ball"].shape), ((16,), (32,), (3,)))
        self.assertGreaterEqual(other["time_s"], one["time_s"])
        self.assertTrue(np.isnan(one["ball"]).all())

    def test_every_row_is_there_or_counted_as_lost(self) -> None:
        with self.system.watch(f"{JOINT}.position", f"{JOINT}.target", "index.fault", "thumb.distal.position") as watch:
            ticks = 0
            last = None
            for _ in range(3):
                samples = watch.read(200, seconds=1.0, timeout=DEADLINE_S)
                self.assertEqual(len(samples), 4)
                position, fault = samples[f"{JOINT}.position"], samples["index.fault"]
                self.assertEqual((position.unit, position.source, position.values.dtype), ("rad", "servo-a:servo", np.float32))
                self.assertEqual(samples.matrix([f"{JOINT}.position", f"{JOINT}.target"]).shape, (len(position), 2))
                self.assertTrue((fault.values == 0).all())
                steps = np.diff(position.tick if last is None else np.append(last, position.tick))
                lost = position.lost_before[1:] if last is None else position.lost_before
                np.testing.assert_array_equal(steps, lost + 1)
                np.testing.assert_allclose(np.diff(position.time), np.diff(position.tick) / 400.0, atol=1e-6)
                last = position.tick[-1]
                ticks += len(position)
            self.assertGreaterEqual(ticks, 600)
            self.assertEqual(watch.changes(), [])
            with self.assertRaises(KeyError):
                samples["thumb"]
        with self.system.watch(GAIN, every=4, capacity=10) as watch:
            # Nobody reads meanwhile: the rest is lost, and is counted.
            end = self.system.now() + 1.0
            while self.system.now() < end:
                pass
            kept = watch.read(10, timeout=DEADLINE_S)[GAIN]
            more = watch.read(1, timeout=DEADLINE_S)[GAIN]
            self.assertEqual((len(kept), kept.tick[0] % 4), (10, more.tick[0] % 4))
            self.assertEqual(more.tick[0] - kept.tick[-1], 4 * (more.lost_before[0] + 1))
            self.assertGreater(more.lost, 10)

    def test_what_is_read_and_watched_often_takes_no_more_room(self) -> None:
        # A visitor has blocks of memory for some thousands of clients, and a loop has few slots.
        for _ in range(50):
            with self.system.watch(f"{JOINT}.position"):
                pass
            self.assertIsInstance(self.system.get(f"{JOINT}.position"), float)
            self.refused(LookupError, "matches `nothing*`", self.system.watch, "nothing*")

    def test_messages_are_sent_and_answered(self) -> None:
        def handled() -> int:
            (servo,) = [it for it in self.system.processors() if it.name == "plant"]
            return next(it.handled for it in servo.vectors if it.name == "plant")

        before = handled()
        # The data is the place of a request, and there is none: the handler answers that it is refused.
        self.assertEqual(self.system.call("plant", "plant", 0xFFFF_FFF0), 0)
        self.system.send(6, 4, 0xFFFF_FFF0)
        self.system.call("plant", 4, 0xFFFF_FFF0)
        self.assertEqual(handled(), before + 3)

    def test_motions_are_enqueued_and_cancelled(self) -> None:
        system = self.system
        self.refused(ValueError, "motion:1:", system.enqueue_text, "[[motion]\n", self.hand)
        plan = self.hand.plan(STEP, {name: 0.0 for name in self.hand.joints[:1]})
        column = plan.column(JOINT)
        self.assertAlmostEqual(plan.position[-1, column], 0.7, places=9)
        with system.watch(f"{JOINT}.position", f"{JOINT}.target") as watch:
            motion = system.enqueue_text(STEP, self.hand)
            outcome = motion.wait(DEADLINE_S)
            self.assertTrue(outcome.is_done, outcome)
            samples = watch.read(1, timeout=DEADLINE_S)
        target, position = samples[f"{JOINT}.target"].values, samples[f"{JOINT}.position"].values
        self.assertAlmostEqual(float(target.max()), 0.9, places=2)
        self.assertLess(float(np.abs(target - position).max()), 0.01)
        # The first one is cancelled while it runs, or before; the second one never begins. Both take seconds.
        system.set_speed(1.0)
        motions = [system.enqueue("counting"), system.enqueue("wave")]
        self.refused(TimeoutError, "the motion has not ended within 0 s; it is ", motions[1].wait, 0)
        system.cancel_motions()
        system.set_speed(None)
        for motion in motions:
            self.assertIn(motion.wait(DEADLINE_S).state, ["aborted", "stopped", "refused"])

    def test_other_threads_run_while_one_waits(self) -> None:
        read = []
        with self.system.watch("index.fault") as watch:
            self.system.pause()
            watch.read()
            waiting = threading.Thread(target=lambda: read.append(watch.read(100, timeout=DEADLINE_S)))
            waiting.start()
            # If the thread that waits kept others from running, time would not go on before its timeout.
            self.system.resume()
            waiting.join(DEADLINE_S)
        (samples,) = read
        self.assertGreaterEqual(len(samples["index.fault"]), 100)

    def test_time_is_paused_and_goes_on(self) -> None:
        with self.system.watch("index.fault") as watch:
            self.system.pause()
            try:
                self.assertTrue(self.paused())
                watch.read()
                self.refused(TimeoutError, "servo-a:servo (", watch.read, 100_000, timeout=0.1)
            finally:
                self.system.resume()
        self.assertFalse(self.paused())

    def test_z_an_injected_fault_is_found(self) -> None:
        system, fingers = self.system, ["index", "middle", "ring", "thumb"]
        terminal = system.terminal("master")
        with system.watch("*.fault", "middle.*.effort") as watch:
            terminal.write("fault middle.proximal-flexor drive\n")
            self.assertIn("has a fault", terminal.read_until("is too low", DEADLINE_S))
            while True:
                samples = watch.read(50, timeout=DEADLINE_S)
                faulty = [it for it in fingers if samples[f"{it}.fault"].values[-1] != 0]
                if faulty:
                    break
        self.assertEqual(faulty, ["middle"])
        efforts = {name: series.values[-1] for name, series in samples.items() if name.endswith(".effort")}
        self.assertEqual(min(efforts, key=lambda name: efforts[name]), "middle.proximal-flexor.effort")
        self.refused(TimeoutError, "the terminal of master has not shown", terminal.read_until, "never", 0.1)

    def test_zz_a_system_that_was_left_is_not_asked(self) -> None:
        with condor.join(self.system.name) as other:
            self.assertEqual(other.name, self.system.name)
        self.refused(condor.Error, "the connection to the system was closed", other.get, GAIN)


if __name__ == "__main__":
    unittest.main()
