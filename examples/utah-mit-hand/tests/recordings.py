"""Records the hand, and reads the recording with programs of others.

    python recordings.py UTAH-MIT-HAND [SECONDS]

The packages `rosbags` and `mcap-ros2-support` read every message with the schemas in the file alone. Both
must find the same values, and those of the rows must be the ones that `export` writes as CSV, each of them.
"""

import csv
import json
import math
import os
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

# How long the hand may take to come up, in seconds.
DEADLINE = 60
SCALARS = (bool, int, float, str)


def plain(value):
    """Returns a message or a part of it as lists, dictionaries and scalars, which can be compared."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, SCALARS):
        # Not every number is equal to itself.
        return "nan" if isinstance(value, float) and math.isnan(value) else value
    names = getattr(value, "__dataclass_fields__", None) or value.__slots__
    # Constants are in capital letters.
    names = [name for name in names if name == name.lower() and not name.startswith("_")]
    return {name: plain(getattr(value, name)) for name in names}


def by_mcap(path):
    """Yields channel, time and message, as mcap-ros2-support reads them."""
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            yield channel, message.log_time, plain(decoded)


def by_rosbags(path):
    """Yields topic, time and message, as rosbags reads them."""
    store = get_typestore(Stores.EMPTY)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, at_ns, raw in reader.messages():
            yield connection.topic, at_ns, plain(reader.deserialize(raw, connection.msgtype))


def messages(path):
    """Returns the messages of each topic, which both readers must read alike, and its channel."""
    all_of, channels, count = {}, {}, 0
    for channel, at_ns, message in by_mcap(path):
        all_of.setdefault(channel.topic, []).append((at_ns, message))
        channels[channel.topic] = channel
    seen = dict.fromkeys(all_of, 0)
    for topic, at_ns, message in by_rosbags(path):
        expected = all_of[topic][seen[topic]]
        assert (at_ns, message) == expected, f"{topic}: {(at_ns, message)} is not {expected}"
        seen[topic] += 1
        count += 1
    for topic, number in seen.items():
        assert number == len(all_of[topic]), f"{topic}: {number} of {len(all_of[topic])}"
    return all_of, channels, count


def labels(path):
    """Returns for each type of rows the labels of its constants."""
    found = {}
    with open(path, "rb") as file:
        for schema in make_reader(file).get_summary().schemas.values():
            of_type = found.setdefault(schema.id, {})
            constants = {}
            for line in schema.data.decode().splitlines():
                if line.startswith("==="):
                    break
                definition, _, comment = line.partition(" # ")
                name = definition.partition(" ")[2]
                constant, is_constant, number = name.partition("=")
                if is_constant:
                    constants[int(number)] = comment
                else:
                    of_type[name] = constants
                    constants = {}
    return found


def written(value, constants, text):
    """Returns whether a cell of the table says this value, to the last bit."""
    if constants:
        return text == constants.get(value, str(value))
    if isinstance(value, bool):
        return text == str(value).lower()
    if isinstance(value, int):
        return text == str(value)
    if value == "nan":
        return text == "NaN"
    number = float(text)
    if number == value and math.copysign(1, number) == math.copysign(1, value):
        return True
    # The shortest text of a number of 32 bits is not that of the same number of 64 bits.
    return struct.pack("f", number) == struct.pack("f", value)


def compare(table, path):
    """Compares a table with the recording; returns the numbers of samples, rows, messages and joints."""
    all_of, channels, count = messages(path)
    of_type = labels(path)
    sources = {}
    for topic, channel in channels.items():
        of_channel = channel.metadata
        if "processor" in of_channel:
            processor, owner = of_channel["processor"], of_channel["loop"]
            sources[f"{processor}:{owner}"] = (topic, channel)
    next_of = dict.fromkeys(sources, 0)
    samples = 0
    with open(table, newline="") as file:
        rows = csv.reader(file)
        head = [title.partition(" [")[0] for title in next(rows)]
        columns = {}
        for place, (topic, channel) in sources.items():
            processor, owner = place.split(":")
            fields = []
            for key, name in channel.metadata.items():
                names = [name, f"{processor}:{name}", f"{place}:{name}"]
                if key.startswith("variable."):
                    found = [title for title in head[4:] if title in names]
                    assert len(found) == 1, f"{name} of {place} has the columns {found}"
                    fields.append((key.removeprefix("variable."), head.index(found[0])))
            columns[place] = fields
        for row in rows:
            at_ns, place, tick, lost = row[:4]
            topic, channel = sources[place]
            at, message = all_of[topic][next_of[place]]
            next_of[place] += 1
            stamp = message["stamp"]["sec"] * 10**9 + message["stamp"]["nanosec"]
            assert int(at_ns) == at == stamp, f"{topic}: {at_ns}, {at}, {stamp}"
            assert (int(tick), int(lost)) == (message["tick"], message["lost"]), topic
            for field, column in columns[place]:
                value = message[field]
                constants = of_type[channel.schema_id].get(field)
                assert written(value, constants, row[column]), f"{topic} {field}: {value}, {row[column]}"
                samples += 1
    joints = check_joints(all_of, sources)
    for place, number in next_of.items():
        assert number == len(all_of[sources[place][0]]), f"{place}: {number} rows in the table"
    return samples, sum(next_of.values()), count, joints


def check_joints(all_of, sources):
    """Checks that the joints are those of the rows of the same instants; returns how many were checked."""
    states = {}
    for at_ns, state in all_of["/joint_states"]:
        assert state["header"]["stamp"]["sec"] * 10**9 + state["header"]["stamp"]["nanosec"] == at_ns
        numbers = zip(state["name"], state["position"], state["velocity"], state["effort"], strict=True)
        states.update({(at_ns, name): rest for name, *rest in numbers})
    frames = {}
    for at_ns, message in all_of["/tf"]:
        for one in message["transforms"]:
            frames.setdefault(one["child_frame_id"], []).append(at_ns)
    checked = 0
    for place in ["servo-a:servo", "servo-b:servo"]:
        topic, channel = sources[place]
        variables = {name: key.removeprefix("variable.") for key, name in channel.metadata.items()}
        joints = [name.removesuffix(".position") for name in variables if name.endswith(".position")]
        for at_ns, row in all_of[topic]:
            for joint in joints:
                fields = [variables[f"{joint}.{what}"] for what in ["position", "velocity", "torque"]]
                assert states[at_ns, joint] == [row[field] for field in fields], (at_ns, joint)
                checked += 1
    assert checked == len(states) > 0, (checked, len(states))
    assert len(frames) >= 16, sorted(frames)
    [(_, model)] = all_of["/robot_description"]
    assert "<robot" in model["data"]
    [(_, fixed)] = all_of["/tf_static"]
    fixed = {one["child_frame_id"] for one in fixed["transforms"]}
    assert not fixed & set(frames), fixed
    return checked


def wait_for_loops(program, up):
    """Waits until both servo processors show their variables."""
    command = [program, "vars", "list", "--json"]
    end = time.monotonic() + DEADLINE
    while up.poll() is None and time.monotonic() < end:
        listed = subprocess.run(command, capture_output=True, text=True)
        if not listed.returncode:
            variables = json.loads(listed.stdout)["variables"]
            if {"servo-a", "servo-b"} <= {it["processor"] for it in variables}:
                return
    raise SystemExit("the hand does not come up")


def main():
    program = Path(sys.argv[1]).resolve()
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 5.0
    with tempfile.TemporaryDirectory() as place:
        place = Path(place)
        os.environ["XDG_RUNTIME_DIR"] = str(place)
        recording, table = place / "hand.mcap", place / "hand.csv"
        up = subprocess.Popen([program, "up", "--headless"], stdout=subprocess.DEVNULL)
        try:
            wait_for_loops(program, up)
            subprocess.run([program, "record", recording, "--for", f"{seconds}s"], check=True)
        finally:
            up.terminate()
            up.wait()
        subprocess.run([program, "export", recording, "--csv", table], check=True)
        samples, rows, count, joints = compare(table, recording)
        assert rows > seconds * 400, f"there are {rows} rows only"
        print(f"{samples} samples of {rows} rows in {count} messages, {joints} states of joints")


if __name__ == "__main__":
    main()
