"""Tunes a gain of the hand in simulated time, runs a motion, and looks at how well the joint follows.

    cargo run -p utah-mit-hand -- up --headless --speed max      (in another shell)
    python tracking.py
"""

# %% Join the hand that runs, and see what is there.
import condor
import numpy as np

JOINT = "index.proximal"
hand = condor.Hand.read("condor-hand/hands/utah-mit.toml")
system = condor.join(timeout=60)
for processor in system.processors():
    loops = ", ".join(f"{loop.name} at {loop.rate_hz:.0f} Hz" for loop in processor.loops)
    print(f"{processor.number} {processor.name}: {processor.state}; {loops}")

# %% A motion, as its master will make it.
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
plan = hand.plan(MOTION, {JOINT: 0.7})
speed = np.abs(plan.velocity[:, plan.column(JOINT)]).max()
print(f"{plan.time[-1]:.2f} s, up to {speed:.2f} rad/s, {len(plan.collisions)} collisions")


# %% Tracking, with a soft gain and with a stiff one.
def tracking_error(bandwidth_hz):
    """Returns times since the first row, s, and target less position, rad; both of the shape (rows,)."""
    system.set(f"{JOINT}.bandwidth_hz", bandwidth_hz)
    with system.watch(f"{JOINT}.target", f"{JOINT}.position") as watch:
        outcome = system.enqueue_text(MOTION, hand).wait()
        samples = watch.read(1)
    assert outcome.is_done, outcome
    target, position = samples[f"{JOINT}.target"], samples[f"{JOINT}.position"]
    # Each row that is not here is counted.
    assert position.tick[-1] - position.tick[0] + 1 == len(position) + position.lost_before[1:].sum()
    return position.time - position.time[0], target.values - position.values


before = system.get(f"{JOINT}.bandwidth_hz")
errors = {}
for bandwidth_hz in [3.0, 10.0]:
    time, error = tracking_error(bandwidth_hz)
    errors[bandwidth_hz] = np.sqrt(np.mean(error**2))
    print(f"{bandwidth_hz:4.1f} Hz: {np.degrees(errors[bandwidth_hz]):.3f} deg rms, {len(time)} rows")
system.set(f"{JOINT}.bandwidth_hz", before)
assert errors[10.0] < errors[3.0]

# %% Something breaks. Which finger gives up, and which tendon has no tension?
terminal = system.terminal("master")
with system.watch("*.fault", "ring.*.tension") as watch:
    terminal.write("fault ring.middle flexor\n")
    terminal.read_until("gave up", timeout=60)
    samples = watch.read(100, timeout=60)
faulty = [name for name in samples if name.endswith(".fault") and samples[name].values.any()]
tensions = {name: samples[name].values[-1] for name in samples if name.endswith(".tension")}
print(f"{faulty[0]} is set; the least tension is {min(tensions.values()):.1f} N: {min(tensions, key=tensions.get)}")
assert (faulty, min(tensions, key=tensions.get)) == (["ring.fault"], "ring.middle.flexor.tension")
terminal.write("clear\nenable\n")
system.close()
