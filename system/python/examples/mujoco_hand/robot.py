#!/usr/bin/env python3
"""The Utah/MIT hand on its table as a model of MuJoCo, behind the registers of its boards.

It is the program of the processor `plant` in system.toml beside this file, which a supervisor starts:

    pip install ./system/python mujoco
    cargo build --release -p utah-mit-hand
    target/release/utah-mit-hand up system/python/examples/mujoco_hand/system.toml

The controllers are those of the hand in Rust, and do not know that the robot is another one. The model of the hand is
the one of condor-hand's tests, which knows nothing of condor-hand. The parameter `cut` is a tendon that breaks.
"""

import sys
from pathlib import Path

import condor
import mujoco
import numpy as np

TREE = Path(__file__).resolve().parents[4]
MODEL = TREE / "condor-hand" / "tests" / "reference" / "hand16.xml"
CONFIGURATION = TREE / "condor-hand" / "hands" / "utah-mit.toml"
RATE_HZ = 2000
# What the actuators of the model take for a tension.
PA_PER_N = 552e3 / 130.0
# Where in the range of its joints the hand begins, from 0 to 1.
BEGINS_AT = 0.4
# The table's axes, as in the configuration: each a mass that is balanced against gravity, and does not feel the hand.
TABLE_KG, TABLE_VISCOUS, TABLE_M = 10.0, 20.0, 0.2


def model_of(hand):
    """Returns the hand of the file with a table beside it."""
    spec = mujoco.MjSpec.from_file(str(MODEL))
    spec.option.timestep = 1.0 / RATE_HZ
    for axis, direction in zip(("x", "y", "z"), np.eye(3)):
        body = spec.worldbody.add_body(name=axis, gravcomp=1.0, mass=TABLE_KG, inertia=[0.01] * 3, explicitinertial=True)
        body.add_joint(
            name=axis, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=direction, damping=TABLE_VISCOUS, range=[-TABLE_M, TABLE_M]
        )
    model = spec.compile()
    assert model.nu == len(hand.outputs.of("actuator")), "the model has the tendons of the configuration"
    return model


class Robot:
    """The model, as the boards see it."""

    def __init__(self, hand):
        self.model = model_of(hand)
        self.data = mujoco.MjData(self.model)
        self.joints = len(hand.joints)
        low, high = hand.limits.T
        self.data.qpos[: self.joints] = low + BEGINS_AT * (high - low)
        mujoco.mj_forward(self.model, self.data)

    def advance(self, commands, cut):
        """One step: actuators do as they are told."""
        tension = commands.effort.copy()
        if cut >= 0:
            tension[cut] = 0.0
        self.data.ctrl[:] = tension * PA_PER_N
        self.data.qfrc_applied[self.joints :] = commands.force
        mujoco.mj_step(self.model, self.data)

    def sensors(self):
        """What the sensors measure: rad, N, m."""
        position, axis = np.split(self.data.qpos, [self.joints])
        return {"position": position, "effort": self.data.sensordata, "axis": axis}


def main():
    hand = condor.Hand.read(sys.argv[1] if len(sys.argv) > 1 else CONFIGURATION)
    robot = Robot(hand)
    simulator = condor.Simulator(
        RATE_HZ,
        variables={f"true.{name}": condor.Shown("rad") for name in hand.joints},
        parameters={"cut": condor.Parameter(-1.0, -1.0, robot.model.nu - 1.0, about="The tendon that is cut; -1 is none.")},
    )
    rack = condor.Rack(simulator, hand)
    rack.show(**robot.sensors())
    rack.plug()
    simulator.print(f"simulates the hand {hand.name} in MuJoCo {mujoco.__version__} at {RATE_HZ} Hz")

    def step(_now):
        robot.advance(rack.commands(), int(simulator.get("cut")))
        sensors = robot.sensors()
        rack.show(**sensors)
        for name, position in zip(hand.joints, sensors["position"]):
            simulator.show(f"true.{name}", position)

    simulator.run(step)


if __name__ == "__main__":
    main()
