"""The hand of a MuJoCo model behind lines of text, for controllers in any language.

    python mujoco_hand.py [hand16.xml]      (pip install mujoco numpy)

A line on standard input, and the answer on standard output:

    reset q...      joint positions, rad; all else at rest
    step u...       the command of each tendon, N; 2.5 ms pass with it held

Both answer with one line: positions (rad), rates (rad/s), tensions (N), in the order of the model:
finger by finger, and of each joint the flexor first. What cannot be done is answered with
`error`, and changes nothing.
"""

import math
import pathlib
import sys

import mujoco
import numpy

PERIOD_S = 2.5e-3
FULL_N = 130.0
FULL_PA = 552e3  # What the actuators of the model take for FULL_N.


class Hand:
    def __init__(self, path):
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        self.updates = round(PERIOD_S / self.model.opt.timestep)

    def reset(self, positions):
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = positions
        mujoco.mj_forward(self.model, self.data)

    def step(self, commands):
        self.data.ctrl[:] = numpy.asarray(commands) * (FULL_PA / FULL_N)
        mujoco.mj_step(self.model, self.data, self.updates)

    def answer(self, line):
        word, *words = line.split()
        lengths = {"reset": self.model.nq, "step": self.model.nu}
        if word not in lengths:
            raise ValueError(f"there is no request {word}")
        if len(words) != lengths[word]:
            raise ValueError(f"{word} takes {lengths[word]} numbers, not {len(words)}")
        numbers = [float(word) for word in words]
        if not all(map(math.isfinite, numbers)):
            raise ValueError(f"{word} takes finite numbers")
        getattr(self, word)(numbers)
        state = numpy.concatenate((self.data.qpos, self.data.qvel, self.data.sensordata))
        return " ".join(f"{value:.12g}" for value in state)


def main():
    beside = pathlib.Path(__file__).parents[2] / "tests" / "reference" / "hand16.xml"
    hand = Hand(sys.argv[1] if len(sys.argv) > 1 else beside)
    for line in filter(str.strip, sys.stdin):
        try:
            print(hand.answer(line), flush=True)
        except ValueError as error:
            print(f"error {error}", flush=True)


if __name__ == "__main__":
    main()
