"""A session with the hand in simulated time, in cells as notebooks have them, from bringing it up to finding what broke.

    pip install './system/python[examples]'
    cargo build --release -p utah-mit-hand
    python system/python/examples/tracking.py

Three arguments may follow: the program of the hand, the description of its system, and the file of the picture.
"""

# %% What to bring up: the robot in Rust, or the one in Python, of which the controllers know no difference.
import sys
from pathlib import Path

import condor
import numpy as np

TREE = Path(__file__).resolve().parents[3]
RUST = TREE / "examples/utah-mit-hand/system.toml"
MUJOCO = TREE / "system/python/examples/mujoco_hand/system.toml"
given = dict(enumerate(sys.argv))
program = given.get(1, TREE / "target/release/utah-mit-hand")
description = given.get(2, MUJOCO)
picture = given.get(3, "tracking.png")

# %% Bring the hand up, in simulated time, as fast as this machine can. Its master runs a motion first.
hand = condor.Hand.read(TREE / "condor-hand/hands/utah-mit.toml")
system = condor.up(program, description, arguments=["--speed", "max"], timeout=120)
terminal = system.terminal("master")
terminal.read_until("(rms ", timeout=120)
for processor in system.processors():
    loops = ", ".join(f"{loop.name} at {loop.rate_hz:.0f} Hz" for loop in processor.loops)
    print(f"{processor.number} {processor.name}: {processor.state}; {loops}")

# %% A motion, as its master will make it.
JOINT = "index.proximal"
MOTION = """
[[motion]]
profile = "minimum-jerk"
duration = 0.4
to = { "index.proximal" = 1.0 }

[[motion]]
profile = "minimum-jerk"
duration = 0.4
to = { "index.proximal" = 0.7 }
"""
system.enqueue_text(MOTION, hand, timeout=60).wait()
plan = hand.plan(MOTION, {JOINT: 0.7})
speed = np.abs(plan.velocity[:, plan.column(JOINT)]).max()
print(f"{plan.time[-1]:.2f} s, up to {speed:.2f} rad/s, {len(plan.collisions)} collisions")


# %% Tune a gain: how well does the joint track, with a soft controller and with stiffer ones?
def tracked(bandwidth_hz):
    """Runs the motion; returns the time since its begin, s, the set-points and the positions, rad; shapes (rows,)."""
    system.set(f"{JOINT}.servo.bandwidth_hz", bandwidth_hz)
    with system.watch(f"{JOINT}.target", f"{JOINT}.position") as watch:
        # The other gain moves the joint a little: it comes to rest first.
        watch.read(seconds=1.0, timeout=60)
        outcome = system.enqueue_text(MOTION, hand, timeout=60).wait()
        samples = watch.read(1)
    assert outcome.is_done, outcome
    target, position = samples[f"{JOINT}.target"], samples[f"{JOINT}.position"]
    # Each row that is not here is counted.
    assert position.tick[-1] - position.tick[0] + 1 == len(position) + position.lost_before[1:].sum()
    begin = np.flatnonzero(np.diff(target.values))[0]
    rows = slice(begin, begin + 300)
    return position.time[rows] - position.time[begin], target.values[rows], position.values[rows]


before = system.get(f"{JOINT}.servo.bandwidth_hz")
runs = {bandwidth_hz: tracked(bandwidth_hz) for bandwidth_hz in (3.0, 6.0, 12.0)}
rms = {bandwidth_hz: np.degrees(np.sqrt(np.mean((run[1] - run[2]) ** 2))) for bandwidth_hz, run in runs.items()}
for bandwidth_hz, error in rms.items():
    print(f"{bandwidth_hz:4.1f} Hz: {error:.3f} deg rms")
best = min(rms, key=rms.get)
system.set(f"{JOINT}.servo.bandwidth_hz", best)
print(f"{JOINT}.servo.bandwidth_hz is {system.get(f'{JOINT}.servo.bandwidth_hz')} now, and was {before}")


# %% Plot it: as a picture, or as text where there is no matplotlib.
def text_plot(time, curves, width=72, height=12):
    """Draws curves, `{mark: values}`, as lines of text."""
    low, high = min(map(np.min, curves.values())), max(map(np.max, curves.values()))
    canvas = np.full((height, width), " ")
    column = np.round((time - time[0]) / np.ptp(time) * (width - 1)).astype(int)
    for mark, values in curves.items():
        canvas[np.round((high - values) / (high - low) * (height - 1)).astype(int), column] = mark
    lines = ["".join(row) for row in canvas]
    return "\n".join([f"{high:8.3f} |{lines[0]}", *(f"         |{line}" for line in lines[1:-1]), f"{low:8.3f} |{lines[-1]}"])


time = runs[best][0]
errors = {str(round(hz)): np.degrees(run[1] - run[2]) for hz, run in runs.items()}
try:
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, (above, below) = plt.subplots(2, sharex=True)
    above.plot(time, runs[best][1], "k--", label="set-point")
    for bandwidth_hz, (of, _, position) in runs.items():
        above.plot(of, position, label=f"{bandwidth_hz:.0f} Hz")
        below.plot(of, np.degrees(runs[bandwidth_hz][1] - position))
    above.set(ylabel=f"{JOINT}, rad")
    below.set(xlabel="time, s", ylabel="error, deg")
    above.legend()
    figure.savefig(picture)
    print(f"{picture} shows it")
except ImportError:
    print("error in degrees with 3, 6 and 12 Hz (mark 3, 6, 1), over the time of the motion:")
    print(text_plot(time, {mark[0]: values for mark, values in errors.items()}))

# %% Something breaks: a tendon, which nobody tells us. The robot in Python has a parameter for it.
tendons = hand.outputs.of("actuator")
broken = int(np.random.default_rng().integers(len(tendons)))
tendon = hand.outputs.names[tendons[broken]]
has_parameter = "cut" in [it.name for it in system.variables()]
if has_parameter:
    system.set("cut", broken)
else:
    terminal.write(f"fault {tendon} drive\n")

# %% Which finger has a fault? And which of its tendons has no tension?
fingers = list(dict.fromkeys(joint.split(".")[0] for joint in hand.joints))
with system.watch("*.fault", "*.effort") as watch:
    faulty = []
    while not faulty:
        samples = watch.read(100, timeout=60)
        faulty = [finger for finger in fingers if samples[f"{finger}.fault"].values[-1] != 0]
tensions = {name: samples[name].values[-1] for name in samples if name.split(".")[0] in faulty and name.endswith(".effort")}
slack = min(tensions, key=tensions.get)
print(f"{', '.join(faulty)} has a fault; the least tension is {tensions[slack]:.1f} N: {slack}")
assert slack == f"{tendon}.effort", f"it was {tendon}"

# %% Mend it, and see that the motion runs again.
if has_parameter:
    system.set("cut", -1)
else:
    terminal.write("clear\n")
outcome = None
while not (outcome and outcome.is_done):
    terminal.write("enable\n")
    try:
        outcome = system.enqueue("open", timeout=60).wait()
    except condor.Refused:
        # A finger is not ready yet.
        outcome = None
print(f"mended: the motion is {outcome.state}")
system.close()
