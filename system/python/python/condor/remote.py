"""Robots of Condor on other machines, over zenoh: `pip install condor[remote]`.

    from condor.remote import Remote

    with Remote("hand", "lab", ["tcp/192.168.0.2:7447"], password="secret") as hand:
        hand.set("index.proximal-flexor.gains.kp", 0.5)
        print(hand.run("wave").state)
        for row in hand.subscribe("/servo_a/"):
            print(row["tick"], row)

Every call has a deadline. Keys, requests and answers are those of the Rust crate `condor-remote`.
"""

from __future__ import annotations

import json
import secrets
import struct
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Any, NamedTuple, Optional, Union

try:
    import zenoh
except ImportError as error:
    raise ImportError("condor.remote needs zenoh: pip install eclipse-zenoh") from error

from . import errors

_VERSION = 2
_PAUSE_S = 0.02
_QUERY_S = 1.0
_KEPT = 1024
_TYPES = {"float32": "f", "float64": "d", "int8": "b", "int16": "h", "int32": "i", "int64": "q",
          "uint8": "B", "uint16": "H", "uint32": "I", "uint64": "Q", "bool": "?"}
_TLS = {
    "authority": "transport/link/tls/root_ca_certificate",
    "certificate": "transport/link/tls/connect_certificate",
    "private_key": "transport/link/tls/connect_private_key",
}

Row = dict[str, Any]
"""A tick of a loop: `time` in s, `tick`, `lost`, and the variables by their names."""


class Refused(errors.Refused):
    """The gateway has refused a request."""

    def __init__(self, error: str, again: bool) -> None:
        super().__init__(error)
        self.again = again
        """Whether the same request may succeed later."""


class NoAnswer(errors.TimedOut):
    """No answer has come in time: what was asked for may have been done."""


class Identity(NamedTuple):
    """The identity of a motion: it runs at most once."""

    session: int
    """The number of the client's session with the queue of the robot."""
    number: int
    """The number of the motion in the session, from 1 on."""


@dataclass(frozen=True)
class Outcome:
    """What has become of a motion."""

    state: str
    """`new`, `accepted`, `started`, `done`, `stopped`, `aborted`, `refused`, `lost`, `broken-off`, `never` or
    `forgotten`, as the README of condor-remote says."""
    reason: str = ""
    """Why it was refused or has ended early; empty without a reason."""
    progress: Optional[float] = None
    """How much of it is done, 0 to 1; None if it does not run, or if nobody knows."""

    @property
    def is_final(self) -> bool:
        """Whether nothing changes any more."""
        return self.state not in ("new", "accepted", "started")

    @property
    def is_done(self) -> bool:
        """Whether it has reached its end."""
        return self.state == "done"

    @property
    def did_not_run(self) -> bool:
        """Whether it is certain that it has not run, and never will."""
        return self.state in ("refused", "lost", "never")


class Remote:
    """A robot, as a client reaches it. While it is open, the client counts as present."""

    def __init__(
        self,
        robot: str,
        client: str,
        connect: Sequence[str],
        *,
        password: Optional[str] = None,
        tls: Optional[Mapping[str, str]] = None,
        timeout: float = 10.0,
    ) -> None:
        """Connects to the router or gateway at the endpoints `connect`, such as `tcp/192.168.0.2:7447`.

        `tls` has the files `authority`, and for mutual TLS `certificate` and `private_key`. `timeout`, s, is that of
        calls without one of their own.
        """
        config = zenoh.Config()

        def put(key: str, value: object) -> None:
            config.insert_json5(key, json.dumps(value))

        put("mode", "client")
        put("connect", {"endpoints": list(connect), "timeout_ms": max(1, int(timeout * 1000)), "exit_on_failure": True,
                        "retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2.0}})
        put("scouting/multicast/enabled", False)
        put("scouting/gossip/enabled", False)
        if password is not None:
            put("transport/auth/usrpwd/user", client)
            put("transport/auth/usrpwd/password", password)
        for key, value in (tls or {}).items():
            put(_TLS[key], value)
        if tls and "certificate" in tls:
            put("transport/link/tls/enable_mtls", True)
        self.robot, self.client, self.timeout = robot, client, timeout
        self._last: Optional[Identity] = None
        self._next = threading.Lock()
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            raise errors.Error(f"cannot connect to {', '.join(connect)}: {error}") from error
        token = secrets.randbits(64)
        self._here = self._session.liveliness().declare_token(f"condor/{robot}/here/{client}/{token}")

    def __enter__(self) -> Remote:
        return self

    def __exit__(
        self,
        kind: Optional[type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leaves the robot."""
        self._session.close()  # type: ignore[no-untyped-call]

    def status(self) -> dict[str, Any]:
        """Returns the state of processors and services."""
        status: dict[str, Any] = self._until("look", {"do": "status"})
        return status

    def topics(self) -> list[dict[str, Any]]:
        """Returns the topics of streams: `name`, `schema_name`, `schema`, and whether it `has_rows`."""
        topics: list[dict[str, Any]] = self._until("look", {"do": "topics"})
        return topics

    def variables(self) -> list[dict[str, Any]]:
        """Returns a description of each variable and parameter."""
        variables: list[dict[str, Any]] = self._until("look", {"do": "variables"})
        return variables

    def get(self, name: str) -> Any:
        """Returns the value of a parameter, or of a field of a published cell."""
        return self._until("look", {"do": "get", "name": name})

    def set(self, name: str, value: object, before: Optional[object] = None) -> Any:
        """Sets a parameter, if it has the value `before`, or whatever it has; returns the value that it had."""
        request = {"do": "set", "name": name, "value": value}
        return self._ask("tune", request | ({} if before is None else {"from": before}), self.timeout)

    def send(self, processor: str, vector: Union[str, int], data: int) -> int:
        """Sends a message of one word, and returns the reply."""
        request = {"do": "send", "processor": processor, "vector": str(vector), "data": data}
        return int(self._ask("move", request, self.timeout))

    def next_id(self) -> Identity:
        """Returns the identity for the next motion."""
        # No other thread may get the same one.
        with self._next:
            last = None if self._last is None else self._last._asdict()
            self._last = Identity(**self._until("move", {"do": "next-id", "last": last}))
            return self._last

    def offer(
        self, id: Identity, motion: Union[str, bytes], takes_control: bool = False, timeout: Optional[float] = None
    ) -> Outcome:
        """Has a motion enqueued (a name, or bytes that the robot reads), at most once, however often it is offered.

        No exception says that it does not run: ask for `outcome`, or `withdraw` it.
        """
        image = motion.encode() if isinstance(motion, str) else motion
        request = {"do": "offer", "id": id._asdict(), "takes_control": takes_control}
        return _outcome(self._until("move", request, image, timeout))

    def outcome(self, id: Identity) -> Outcome:
        """Returns what has become of a motion."""
        return _outcome(self._until("look", {"do": "outcome", "id": id._asdict()}))

    def withdraw(self, id: Identity) -> Outcome:
        """Withdraws a motion: if the robot has not received it yet, it never runs. Returns what has become of it."""
        return _outcome(self._until("move", {"do": "withdraw", "id": id._asdict()}))

    def wait(self, id: Identity, timeout: Optional[float] = None) -> Outcome:
        """Waits until nothing changes any more about a motion that was offered."""
        request = {"do": "outcome", "id": id._asdict()}
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while True:
            outcome = _outcome(self._until("look", request, None, deadline - time.monotonic()))
            if outcome.is_final:
                return outcome
            if time.monotonic() >= deadline:
                raise NoAnswer(f"the motion is {outcome.state}")
            time.sleep(_PAUSE_S)

    def run(self, motion: Union[str, bytes], timeout: float = 60.0) -> Outcome:
        """Has a motion run, and waits for its end."""
        id, deadline = self.next_id(), time.monotonic() + timeout
        outcome = self.offer(id, motion, timeout=timeout)
        return outcome if outcome.is_final else self.wait(id, deadline - time.monotonic())

    def stop(self) -> None:
        """Ends all motion of the robot."""
        self._until("move", {"do": "stop"})

    def subscribe(self, name: str) -> Stream:
        """Returns the rows of a topic, by its name or a part of it that no other one has."""
        topics = self.topics()
        found = [it for it in topics if it["name"] == name] or [it for it in topics if name in it["name"]]
        if len(found) != 1:
            raise errors.NotFound(f"there is no topic `{name}`; there are {', '.join(it['name'] for it in topics)}")
        return Stream(self._session, self.robot, found[0], self.timeout)

    def _until(
        self, right: str, request: dict[str, Any], motion: Optional[bytes] = None, timeout: Optional[float] = None
    ) -> Any:
        deadline = time.monotonic() + (self.timeout if timeout is None else timeout)
        while True:
            try:
                return self._ask(right, request, max(0.001, min(_QUERY_S, deadline - time.monotonic())), motion)
            except (NoAnswer, Refused) as error:
                if isinstance(error, Refused) and not error.again or time.monotonic() >= deadline:
                    raise
            time.sleep(_PAUSE_S)

    def _ask(self, right: str, request: dict[str, Any], timeout: float, motion: Optional[bytes] = None) -> Any:
        key = f"condor/{self.robot}/by/{self.client}/{right}"
        payload = json.dumps({"version": _VERSION} | request)
        for reply in self._session.get(key, payload=payload, attachment=motion, timeout=timeout):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_bytes())
            try:
                refusal = json.loads(reply.err.payload.to_bytes()) if reply.err is not None else None
            except ValueError:
                break
            if refusal is not None:
                raise Refused(refusal["error"], refusal["again"])
        raise NoAnswer(f"`{self.robot}` has not answered within {timeout:.1f} s: it is not there, "
                       "or this client may not ask it")


class Stream:
    """The messages of a topic, which `Remote.subscribe` makes: rows, or the bytes of messages that are none."""

    def __init__(self, session: zenoh.Session, robot: str, topic: dict[str, Any], timeout: float) -> None:
        self.topic = topic
        self.timeout = timeout
        """How long `next` waits, s."""
        self.lost = 0
        """The number of messages and rows that were lost so far, wherever."""
        self._last: Optional[tuple[int, int]] = None
        self._fields = _fields_of(topic["schema"]) if topic["has_rows"] else None
        key = f"condor/{robot}/streams{topic['name']}"
        self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(_KEPT))

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> Any:
        deadline = time.monotonic() + self.timeout
        while (sample := self._subscriber.try_recv()) is None:
            if time.monotonic() >= deadline:
                raise NoAnswer(f"no message of {self.topic['name']} within {self.timeout} s")
            time.sleep(0.002)
        # Each message of a stream has its place.
        assert sample.attachment is not None
        incarnation, number = struct.unpack("<QQ", sample.attachment.to_bytes())
        if self._last is not None and self._last[0] == incarnation:
            self.lost += max(0, number - self._last[1] - 1)
        self._last = (incarnation, number)
        message = sample.payload.to_bytes()
        if self._fields is None:
            return message
        row = _decode(self._fields, message)
        self.lost += row["lost"]
        return row

    def close(self) -> None:
        """Ends the subscription."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def _outcome(told: dict[str, Any]) -> Outcome:
    """Reads an outcome; what a later version adds is ignored."""
    return Outcome(told["state"], told.get("reason", ""), told.get("progress"))


def _fields_of(schema: str) -> list[tuple[str, str]]:
    """Returns the fields of a row's type: the name of the variable, and the format of its value."""
    fields: list[tuple[str, str]] = []
    for line in schema.split("====")[0].splitlines()[1:]:
        definition, _, comment = line.partition(" # ")
        kind, _, name = definition.partition(" ")
        if "=" not in name and kind in _TYPES:
            # The first two are the tick, and the number of lost rows.
            fields.append((name if len(fields) < 2 else comment.split("\t")[0], _TYPES[kind]))
    return fields


def _decode(fields: list[tuple[str, str]], message: bytes) -> Row:
    """Reads a row from its bytes, which are CDR."""
    seconds, nanoseconds = struct.unpack_from("<iI", message, 4)
    row: Row = {"time": seconds + nanoseconds * 1e-9}
    place = 8
    for name, form in fields:
        size = struct.calcsize("<" + form)
        place += -place % size
        (row[name],) = struct.unpack_from("<" + form, message, 4 + place)
        place += size
    return row
