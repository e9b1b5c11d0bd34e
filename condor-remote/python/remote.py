"""Robots of Condor on other machines, over zenoh (the package `eclipse-zenoh`).

    with Remote("hand", "lab", ["tcp/192.168.0.2:7447"], password="secret") as hand:
        hand.set("index.proximal.flexor.kt", 0.5)
        print(hand.run("wave"))
        for row in hand.subscribe("/servo_a/"):
            print(row["tick"], row)

Every call has a deadline. Keys, requests and answers are those of the Rust crate `condor-remote`.
"""

import itertools
import json
import struct
import time

import zenoh

VERSION = 1
OPEN = {"new", "offered", "accepted", "started"}
DID_NOT_RUN = {"refused", "lost", "never", "withdrawn", "superseded"}
PAUSE = 0.02
QUERY = 1.0
TYPES = {"float32": "f", "float64": "d", "int8": "b", "int16": "h", "int32": "i", "int64": "q",
         "uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "bool": "?"}


class Refused(Exception):
    """The gateway has refused a request. `again`: the same one may succeed later."""

    def __init__(self, error, again):
        super().__init__(error)
        self.again = again


class NoAnswer(Exception):
    """No answer has come in time: what was asked for may have been done."""


class Remote:
    """A robot, as a client reaches it. While it is open, the client counts as present."""

    def __init__(self, robot, client, connect, password=None, tls=None, timeout=10.0, incarnation=None):
        config = zenoh.Config()
        put = lambda key, value: config.insert_json5(key, json.dumps(value))
        put("mode", "client")
        put("connect", {"endpoints": connect, "timeout_ms": max(1, int(timeout * 1000)), "exit_on_failure": True,
                        "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2.0}})
        put("scouting/multicast/enabled", False)
        put("scouting/gossip/enabled", False)
        if password is not None:
            put("transport/auth/usrpwd/user", client)
            put("transport/auth/usrpwd/password", password)
        for key, value in (tls or {}).items():
            put({"authority": "transport/link/tls/root_ca_certificate",
                 "certificate": "transport/link/tls/connect_certificate",
                 "private_key": "transport/link/tls/connect_private_key"}[key], value)
        if tls and "certificate" in tls:
            put("transport/link/tls/enable_mtls", True)
        self.robot, self.client, self.timeout = robot, client, timeout
        self.incarnation = time.time_ns() if incarnation is None else incarnation
        self._numbers = itertools.count(1)
        self._session = zenoh.open(config)
        self._here = self._session.liveliness().declare_token(f"condor/{robot}/here/{client}/{self.incarnation}")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leaves the robot."""
        self._session.close()

    def status(self):
        """The state of processors and services."""
        return self._until("look", {"do": "status"})

    def topics(self):
        """The topics of streams."""
        return self._until("look", {"do": "topics"})

    def variables(self):
        """A description of each variable and parameter."""
        return self._until("look", {"do": "variables"})

    def get(self, name):
        """The value of a parameter, or of a field of a published cell."""
        return self._until("look", {"do": "get", "name": name})

    def set(self, name, value, before=None):
        """Sets a parameter, if it has the value `before`, or whatever it has; returns the value that it had."""
        request = {"do": "set", "name": name, "value": value}
        return self._ask("tune", request | ({} if before is None else {"from": before}), self.timeout)

    def send(self, processor, vector, data):
        """Sends a message, and returns the reply."""
        request = {"do": "send", "processor": processor, "vector": str(vector), "data": data}
        return self._ask("move", request, self.timeout)

    def next_id(self):
        """The identity for the next motion."""
        return {"incarnation": self.incarnation, "number": next(self._numbers)}

    def offer(self, id, motion, takes_control=False, timeout=None):
        """Has a motion enqueued (a name, or bytes that the robot reads), at most once, however often it is offered.

        No exception says that it does not run: ask for `outcome`, or `withdraw` it.
        """
        motion = motion.encode() if isinstance(motion, str) else motion
        request = {"do": "offer", "id": id, "takes_control": takes_control}
        return self._decided("move", request, motion, lambda state: state != "offered", timeout)

    def outcome(self, id):
        """What has become of a motion."""
        return self._until("look", {"do": "outcome", "id": id})

    def withdraw(self, id):
        """Makes sure that a motion never runs which the gateway has not received; returns what has become of it."""
        return self._until("move", {"do": "withdraw", "id": id})

    def wait(self, id, timeout=None):
        """Waits until nothing changes any more about a motion that was offered."""
        return self._decided("look", {"do": "outcome", "id": id}, None, lambda state: state not in OPEN, timeout)

    def run(self, motion, timeout=60.0):
        """Has a motion run, and waits for its end."""
        id, deadline = self.next_id(), time.monotonic() + timeout
        outcome = self.offer(id, motion, timeout=timeout)
        return outcome if outcome["state"] not in OPEN else self.wait(id, deadline - time.monotonic())

    def stop(self):
        """Ends all motion of the robot."""
        self._until("move", {"do": "stop"})

    def subscribe(self, name):
        """The rows of a topic, by its name or a part of it that no other one has."""
        topics = self.topics()
        found = [it for it in topics if it["name"] == name] or [it for it in topics if name in it["name"]]
        if len(found) != 1:
            raise KeyError(f"there is no topic `{name}`; there are {', '.join(it['name'] for it in topics)}")
        return Stream(self._session, self.robot, found[0], self.timeout)

    def _decided(self, right, request, motion, is_good, timeout):
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while True:
            outcome = self._until(right, request, motion, deadline - time.monotonic())
            if is_good(outcome["state"]):
                return outcome
            if time.monotonic() >= deadline:
                raise NoAnswer(f"the motion is {outcome['state']}")
            time.sleep(PAUSE)

    def _until(self, right, request, motion=None, timeout=None):
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while True:
            try:
                return self._ask(right, request, max(0.001, min(QUERY, deadline - time.monotonic())), motion)
            except (NoAnswer, Refused) as error:
                if isinstance(error, Refused) and not error.again or time.monotonic() >= deadline:
                    raise
            time.sleep(PAUSE)

    def _ask(self, right, request, timeout, motion=None):
        key = f"condor/{self.robot}/by/{self.client}/{right}"
        payload = json.dumps({"version": VERSION} | request)
        for reply in self._session.get(key, payload=payload, attachment=motion, timeout=timeout):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_bytes())
            try:
                refusal = json.loads(reply.err.payload.to_bytes())
            except ValueError:
                break
            raise Refused(refusal["error"], refusal["again"])
        raise NoAnswer(f"`{self.robot}` has not answered within {timeout:.1f} s: it is not there, "
                       "or this client may not ask it")


class Stream:
    """The messages of a topic: dictionaries of rows, or the bytes of other messages. `lost` counts all that were lost."""

    def __init__(self, session, robot, topic, timeout):
        self.topic, self.timeout, self.lost, self._last = topic, timeout, 0, None
        self._fields = fields_of(topic["schema"]) if topic["has_rows"] else None
        key = f"condor/{robot}/streams{topic['name']}"
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(1024))

    def __iter__(self):
        return self

    def __next__(self):
        deadline = time.monotonic() + self.timeout
        while (sample := self._subscriber.try_recv()) is None:
            if time.monotonic() >= deadline:
                raise NoAnswer(f"no message of {self.topic['name']} within {self.timeout} s")
            time.sleep(0.002)
        life, number = struct.unpack("<QQ", sample.attachment.to_bytes())
        if self._last is not None and self._last[0] == life:
            self.lost += max(0, number - self._last[1] - 1)
        self._last = (life, number)
        message = sample.payload.to_bytes()
        if self._fields is None:
            return message
        row = decode(self._fields, message)
        self.lost += row["lost"]
        return row

    def close(self):
        """Ends the subscription."""
        self._subscriber.undeclare()


def fields_of(schema):
    """The fields of a row's type: the name of the variable, and the format of its value."""
    fields = []
    for line in schema.split("====")[0].splitlines()[1:]:
        definition, _, comment = line.partition(" # ")
        kind, _, name = definition.partition(" ")
        if "=" not in name and kind in TYPES:
            # The first two are the tick, and the number of lost rows.
            fields.append((name if len(fields) < 2 else comment.split("\t")[0], TYPES[kind]))
    return fields


def decode(fields, message):
    """Reads a row from its bytes, which are CDR."""
    seconds, nanoseconds = struct.unpack_from("<iI", message, 4)
    row, place = {"time": seconds + nanoseconds * 1e-9}, 8
    for name, form in fields:
        size = struct.calcsize("<" + form)
        place += -place % size
        (row[name],) = struct.unpack_from("<" + form, message, 4 + place)
        place += size
    return row
