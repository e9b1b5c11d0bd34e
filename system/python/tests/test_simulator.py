"""The promises of the package about robots in Python: one of its own, and the boards of a hand."""

from __future__ import annotations

import os
import re
import sys
import tempfile
import time
import unittest
from pathlib import Path
from typing import Union, cast

import condor
import numpy as np
import numpy.typing as npt
from hand_in_simulated_time import CONFIGURATION, DEADLINE_S, PROGRAM

# A mass on a slide, with a register for the force, mN, and one for the position, µm.
ROBOT = """
import condor
import numpy as np

robot = condor.Simulator(
    1000,
    variables={"position": condor.Shown("m", "Of the mass."), "steps": condor.Shown()},
    parameters={"mass": condor.Parameter(2.0, 0.1, 10.0, "kg"), "fails": condor.Parameter(0.0, 0.0, 1.0)},
)
robot.bus.write(0x00, [0xCAFE, 0])
state = np.zeros(3)

def step(now):
    force = robot.bus.read(0x10, width=4).astype(np.int32)[0] * 1e-3
    if robot.get("fails"):
        raise ValueError("the spring is broken")
    state[1] += force / robot.get("mass") / robot.rate_hz
    state[0] += state[1] / robot.rate_hz
    state[2] += 1
    robot.bus.write(0x14, [round(state[0] * 1e6)], width=4)
    robot.show("position", state[0])
    robot.show("steps", state[2])
    if state[2] == 3:
        robot.print(f"processor {robot.number} at {now:.6f} s")
        assert refused(lambda: robot.show("speed", 0.0)) and refused(lambda: robot.get("speed"))
        assert refused(lambda: robot.bus.read(0x100_0000)) and refused(lambda: robot.bus.read(0, width=3))
        assert refused(lambda: robot.bus.write(0, 0.5)) and robot.bus.read(0)[0] == 0xCAFE

def refused(call):
    try:
        call()
    except condor.Error:
        return True

robot.bus.write(0x10, [500], width=4)
robot.run(step)
"""
DESCRIPTION = """
name = "slide"
window_bytes = 65536
[clock]
kind = "simulated"
[bus]
bytes = 4096
[[processors]]
number = 3
name = "slide"
program = "robot.py"
"""


class SimulatorTest(unittest.TestCase):
    def setUp(self) -> None:
        place = tempfile.TemporaryDirectory()
        self.addCleanup(place.cleanup)
        self.place = Path(place.name)
        os.environ["XDG_RUNTIME_DIR"] = place.name

    def up(self, robot: str, clock: str = "simulated") -> condor.System:
        script = self.place / "robot.py"
        script.write_text(f"#!{sys.executable}\n{robot}")
        script.chmod(0o755)
        (self.place / "slide.toml").write_text(DESCRIPTION)
        arguments = ["--speed", "max"] if clock == "simulated" else ["--clock", clock]
        system = condor.up(PROGRAM, self.place / "slide.toml", arguments=arguments, timeout=DEADLINE_S)
        self.addCleanup(system.close)
        return system

    def test_a_robot_of_ones_own_moves_in_simulated_time(self) -> None:
        system = self.up(ROBOT)
        self.assertIn("processor 3 at 0.002500 s", system.terminal("slide").read_until(" s\r", DEADLINE_S))
        (slide,) = system.processors()
        self.assertEqual([(loop.name, loop.rate_hz, loop.overruns) for loop in slide.loops], [("robot", 1000.0, 0)])
        with system.watch("position", "steps", "mass") as watch:
            samples = watch.read(100, timeout=DEADLINE_S)
            position, steps = samples["position"].values, samples["steps"].values
            # Each step adds as much as the mass has gone: x = a dt² n (n + 1) / 2, with a = 0.5 N / 2 kg.
            np.testing.assert_allclose(position, 0.25e-6 * steps * (steps + 1) / 2, rtol=1e-9)
            np.testing.assert_array_equal(np.diff(samples["steps"].tick), samples["steps"].lost_before[1:] + 1)
            np.testing.assert_allclose(samples["steps"].time, (steps - 0.5) / 1000, atol=1e-9)
            self.assertEqual(system.set("mass", 4), 2.0)
            with self.assertRaises(condor.Refused):
                system.set("mass", 11.0)
            while samples["mass"].values[-1] != 4.0:
                samples = watch.read(10, timeout=DEADLINE_S)
            # Three samples in succession; on a busy machine some are lost.
            whole = np.zeros(0, dtype=bool)
            while not whole.any():
                rows = np.flatnonzero(samples["mass"].values == 4.0)
                lost = samples["steps"].lost_before[rows]
                whole = (lost[1:-1] == 0) & (lost[2:] == 0)
                bends = np.diff(samples["position"].values[rows], 2)[whole]
                samples = watch.read(10, timeout=DEADLINE_S)
            np.testing.assert_allclose(bends, 0.125e-6, atol=1e-9)

    def test_it_runs_by_the_real_clock_too(self) -> None:
        system = self.up(ROBOT, "real")
        self.assertIsNone(system.clock())
        with system.watch("position", "steps") as watch:
            samples = watch.read(50, timeout=DEADLINE_S)
        steps = samples["steps"].values
        np.testing.assert_array_equal(np.diff(steps), samples["steps"].lost_before[1:] + 1)
        np.testing.assert_allclose(samples["position"].values, 0.25e-6 * steps * (steps + 1) / 2, rtol=1e-9)
        system.stop("slide", timeout=DEADLINE_S)
        (slide,) = system.processors()
        self.assertEqual((slide.state, slide.last_exit), ("stopped", "exit status 0"))

    def test_a_robot_that_prints_more_than_its_terminal_holds_goes_on(self) -> None:
        system = self.up(ROBOT.replace("    if state[2] == 3:", "    robot.print(f'{state[2]:.0f} {200 * chr(61)}')\n    if state[2] == 3:"))
        with system.watch("steps") as watch:
            samples = watch.read(1000, timeout=DEADLINE_S)
        self.assertGreater(samples["steps"].values[-1], 1000)
        terminal = system.terminal("slide")
        self.assertIn(f"1500 {200 * '='}", terminal.read_until("1500 " + 200 * "=", DEADLINE_S))

    def test_a_step_that_fails_ends_the_program_which_begins_anew(self) -> None:
        system = self.up(ROBOT)
        system.set("fails", 1)
        end = time.monotonic() + DEADLINE_S
        while (slide := system.processors()[0]).restarts == 0 or slide.state != "running":
            self.assertLess(time.monotonic(), end, slide)
        # Its parameters are those of the beginning.
        self.assertEqual(system.get("fails", timeout=DEADLINE_S), 0.0)
        log = "".join(path.read_text() for path in self.place.rglob("log"))
        self.assertIn("ValueError: the spring is broken", log)

    def test_a_system_that_cannot_come_up_says_why(self) -> None:
        with self.assertRaises(condor.Error) as raised:
            condor.up(PROGRAM, self.place / "none.toml")
        self.assertIn("none.toml", str(raised.exception))
        with self.assertRaises(condor.Error) as raised:
            condor.up(self.place / "no-program")
        self.assertIn("no-program: No such file or directory", str(raised.exception))
        self.assertEqual(condor.running(), [])

    def test_a_simulator_is_a_processor_of_a_system(self) -> None:
        with self.assertRaises(condor.Error) as raised:
            condor.Simulator(1000)
        self.assertIn("the environment has no CONDOR_PROCESS", str(raised.exception))


class Memory:
    """A bus of memory for a rack without a system; it is simulator and bus in one."""

    rate_hz = 1000

    def __init__(self) -> None:
        self.bytes = np.zeros(0x4000, np.uint8)

    @property
    def bus(self) -> Memory:
        return self

    def read(self, address: int, count: int = 1, *, width: int = 2) -> npt.NDArray[np.uint32]:
        return self.bytes[address : address + count * width].view(f"<u{width}").astype(np.uint32)

    def write(self, address: int, values: Union[int, npt.ArrayLike], *, width: int = 2) -> None:
        array = np.atleast_1d(np.asarray(values)).astype(f"<u{width}")
        self.bytes[address : address + array.nbytes] = array.view(np.uint8)


class RackTest(unittest.TestCase):
    def setUp(self) -> None:
        self.hand = condor.Hand.read(CONFIGURATION)
        self.memory = Memory()
        self.rack = condor.Rack(
            cast(condor.Simulator, self.memory), self.hand, watchdog_s=0.003, ramp_s=0.004
        )

    def test_wires_are_those_of_the_configuration(self) -> None:
        inputs, outputs = self.hand.inputs, self.hand.outputs
        self.assertEqual((len(inputs), len(outputs)), (16 + 32 + 3 + inputs.kinds.count("touch"), 32 + 3))
        wire = inputs.index("actuator", "index.proximal-flexor")
        self.assertEqual((inputs.names[wire], inputs.bits[wire], inputs.is_output), ("index.proximal-flexor", 12, False))
        counts = np.arange(len(inputs)) * 7
        np.testing.assert_array_equal(inputs.counts(inputs.values(counts)), counts)
        np.testing.assert_array_equal(outputs.counts(outputs.values(counts[:35])), counts[:35])
        self.assertEqual(inputs.counts(np.full(len(inputs), np.nan)).max(), 0)
        np.testing.assert_array_equal(outputs.counts(np.full(35, np.nan)), outputs.counts(np.zeros(35)))
        self.assertEqual(inputs.counts(np.full(len(inputs), 1e9)).max(), 4095)
        self.assertEqual(outputs.at_rest[outputs.index("actuator", "thumb.distal-extensor")], 4.0)
        with self.assertRaises(LookupError):
            inputs.index("actuator", "index.distal-flexer")

    def test_sensors_are_registers(self) -> None:
        position = np.linspace(0.1, 0.9, 16)
        effort = np.linspace(4.0, 60.0, 32)
        self.rack.show(position=position, effort=effort, axis=[0.1, 0.0, -0.1])
        inputs = self.hand.inputs
        for kind, name, value in [("position", "index.abduction", 0.1), ("actuator", "thumb.distal-extensor", 60.0)]:
            wire = inputs.index(kind, name)
            at = 0x200 * inputs.board[wire] + 0x100 * (inputs.channel[wire] // 16) + 0x20 + 2 * (inputs.channel[wire] % 16)
            (counts,) = self.memory.read(int(at))
            self.assertLessEqual(abs(inputs.gain[wire] * counts + inputs.offset[wire] - value), abs(inputs.gain[wire]) / 2)
        counters = self.memory.read(0x2020, 3, width=4)
        np.testing.assert_array_equal(counters, inputs.counts(np.full(len(inputs), 0.1))[inputs.of("axis")] - [0, 1000, 2000])
        # A sensor that is stuck shows what it has shown.
        self.rack.stick("position", "index.abduction")
        before = self.memory.read(0x20, 16)
        self.rack.show(position=position + 0.1, effort=effort)
        stuck = inputs.index("position", "index.abduction")
        changed = self.memory.read(0x20, 16) != before
        self.assertFalse(changed[inputs.channel[stuck]])
        self.assertTrue(changed.any())
        self.rack.mend()
        self.rack.show(position=position + 0.1, effort=effort)
        self.assertNotEqual(self.memory.read(0x20, 16)[inputs.channel[stuck]], before[inputs.channel[stuck]])

    def test_only_actuators_with_a_sensor_are_measured_and_motors_rest_at_nothing(self) -> None:
        # The first actuator of each finger is a motor, and those of the thumb alone have sensors.
        text = CONFIGURATION.read_text()
        head, tail = text.split("[actuator_defaults]")
        defaults, fingers = tail.split("\n\n", 1)
        defaults = re.sub("^(faults|adc|gains) = .*\n?", "", defaults, flags=re.MULTILINE)
        fingers, thumb = fingers.split('name = "thumb"')
        fingers = re.sub(r"adc = \{ channel = \d+ \}, dac", "dac", fingers)
        thumb = re.sub(
            r"adc = \{ channel = (\d+) \}, dac",
            r"adc = { board = 1, channel = \1, bits = 12, gain = 0.05, offset = -50.0 }, dac",
            thumb,
        )
        fingers = fingers.replace(
            "arms = { abduction = 0.0127 }, dac = {",
            "arms = { abduction = 0.0127 }, limits = { low = -10.0, high = 10.0, bias = 0.0 }, dac = { offset = 2000.0,",
            1,
        )
        hand = condor.Hand.parse(f'{head}[actuator_defaults]{defaults}\n\n{fingers}name = "thumb"{thumb}')
        inputs, outputs = hand.inputs, hand.outputs
        self.assertEqual((len(inputs.of("actuator")), len(outputs.of("actuator"))), (8, 32))
        at_rest = ([0.0] + [4.0] * 7) * 4
        self.assertEqual(outputs.at_rest[outputs.of("actuator")].tolist(), at_rest)
        rack = condor.Rack(cast(condor.Simulator, self.memory), hand)
        self.assertEqual(rack.commands().effort.tolist(), at_rest)
        rack.show(position=np.zeros(16), effort=np.arange(32.0))
        # A slot has two boards of 16 channels.
        thumb_channels = self.memory.read(0x0300 + 0x20 + 2 * 8, 8)
        np.testing.assert_array_equal(thumb_channels, (np.arange(24, 32) + 50) * 20)
        self.assertEqual(self.memory.read(0x0200 + 0x20, 16).tolist(), [0] * 16)
        with self.assertRaises(ValueError):
            rack.show(position=np.zeros(16), effort=np.zeros(8))

    def test_boards_that_are_not_strobed_rest(self) -> None:
        self.assertEqual(self.memory.read(0x1000)[0], 0)
        self.rack.plug()
        identities = [int(self.memory.read(base)[0]) for base in (0x0000, 0x0300, 0x1000, 0x1500, 0x2000)]
        self.assertEqual(identities, [0xADC0, 0xADC0, 0xDAC0, 0xDAC0, 0xE4C0])
        outputs = self.hand.outputs
        wire = outputs.index("actuator", "index.abduction-flexor")
        self.assertEqual((outputs.board[wire], outputs.channel[wire]), (0, 0))
        first, zero = outputs.of("actuator").tolist().index(wire), outputs.counts(np.zeros(35))[wire]
        self.assertEqual(self.rack.commands().effort[first], 4.0)
        self.memory.write(0x1002, 1)
        counts = outputs.counts(np.full(35, 12.0))[wire]
        self.memory.write(0x1020, counts - zero)
        self.memory.write(0x1004, 1)
        told = (counts - outputs.offset[wire]) / outputs.gain[wire]
        self.assertAlmostEqual(told, 12.0, delta=0.05)
        seen = [self.rack.commands().effort[first]]
        self.assertEqual((self.memory.read(0x1004)[0], self.rack.resting[:2]), (0, [False, True]))
        seen += [self.rack.commands().effort[first] for _ in range(8)]
        ramp = [told + (4.0 - told) * part for part in (0.0, 0.25, 0.5, 0.75, 1.0, 1.0)]
        np.testing.assert_allclose(seen, [told] * 3 + ramp)
        self.assertTrue(self.rack.resting[0])
        # It goes on with the next strobe, and rests at once when nobody has it open.
        self.memory.write(0x1004, 1)
        self.assertEqual((self.rack.commands().effort[first], self.rack.resting[0]), (told, False))
        self.memory.write(0x1002, 0)
        self.rack.commands()
        self.assertTrue(self.rack.resting[0])
        self.assertEqual(self.rack.commands().force.tolist(), [0.0, 0.0, 0.0])


if __name__ == "__main__":
    unittest.main()
