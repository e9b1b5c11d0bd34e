"""A hand as its configuration describes it, without any processor: for notebooks."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _condor
from .errors import Error, NotFound, Refused

Array = npt.NDArray[np.float64]

Positions = Union[Mapping[str, float], Sequence[float], npt.NDArray[np.float64], None]
"""Positions of joints, rad: an array of the shape (joints,), or some by their names; others are at 0."""


@dataclass(frozen=True)
class Posture:
    """What inverse kinematics has found."""

    positions: npt.NDArray[np.float64]
    """The positions of all joints, rad; shape (joints,)."""
    is_reached: bool
    """Whether the frame is at the point, within a micrometre."""
    distance: float
    """The distance from the frame to the point, m."""
    held: dict[str, float]
    """The joints that hold the frame off the point, each with the limit at which it is, rad."""


@dataclass(frozen=True)
class Clearance:
    """The distance between two parts."""

    parts: tuple[str, str]
    points: npt.NDArray[np.float64]
    """The nearest point of the middle line of each part, m; shape (2, 3)."""
    distance: float
    """The distance between the surfaces, m: below 0 if they meet."""


@dataclass(frozen=True)
class Event:
    """What happens to a step of a motion."""

    at: float
    """The time since the start, s."""
    step: int
    """The step, from 1, in the order of the text."""
    what: str
    """`begins`, `begins-adjusted`, `reached`, `stopped`, `superseded`, `dropped`, `refused`, `waits` or `holds`."""
    reason: Optional[str]
    """Why it is refused."""


@dataclass(frozen=True)
class Overload:
    """A time in which actuators cannot give the torque that a motion takes of a joint."""

    joint: str
    from_s: float
    to_s: float
    torque: float
    """The torque that is farthest from what can be given, N m."""
    possible: float
    """The torque that the actuators give then, N m."""


@dataclass(frozen=True)
class Collision:
    """A time in which two parts meet."""

    from_s: float
    to_s: float
    deepest: Clearance
    """The parts where they are deepest in each other."""


@dataclass(frozen=True)
class Plan:
    """A motion, tick by tick of the processor that makes the set-points; they are the same to the last bit."""

    joints: list[str]
    time: npt.NDArray[np.float64]
    """The times since the start, s; shape (ticks,)."""
    position: npt.NDArray[np.float64]
    """The set-points, rad; shape (ticks, joints)."""
    velocity: npt.NDArray[np.float64]
    """Their rates, rad/s; shape (ticks, joints)."""
    acceleration: npt.NDArray[np.float64]
    """Their accelerations, rad/s²; shape (ticks, joints)."""
    torque: npt.NDArray[np.float64]
    """The torques that the motion takes in free space, N m; shape (ticks, joints)."""
    events: list[Event]
    overloads: list[Overload]
    collisions: list[Collision]

    def column(self, joint: str) -> int:
        """Returns the column of a joint in the arrays."""
        if joint not in self.joints:
            raise Refused(f"there is no joint {joint!r}; there are {', '.join(self.joints)}")
        return self.joints.index(joint)


@dataclass(frozen=True)
class Wires:
    """The channels of sensors or of actuators, with their calibrations; arrays have the shape (wires,).

    They are in the order of the configuration: finger by finger, its joints before its actuators.
    """

    names: list[str]
    """What is at the end: `finger.joint`, `finger.actuator`, `finger` of a tip, or an axis of the table."""
    kinds: list[str]
    """`position` of a joint, effort of an `actuator`, `touch` of a tip, or `axis` of the table."""
    board: npt.NDArray[np.int64]
    channel: npt.NDArray[np.int64]
    bits: npt.NDArray[np.int64]
    """The widths of the converters."""
    gain: Array
    offset: Array
    at_rest: Array
    """The efforts of actuators from which nothing is asked, N or N m: of a tendon its least tension; 0 of all else."""
    is_output: bool
    """Whether they are of actuators: counts = gain * value + offset. Of sensors, value = gain * counts + offset."""

    def __len__(self) -> int:
        return len(self.names)

    def of(self, *kinds: str) -> npt.NDArray[np.intp]:
        """Returns the indices of the wires of these kinds."""
        return np.flatnonzero(np.isin(self.kinds, kinds))

    def index(self, kind: str, name: str) -> int:
        """Returns the index of a wire."""
        for index, wire in enumerate(zip(self.kinds, self.names)):
            if wire == (kind, name):
                return index
        raise NotFound(f"there is no {kind} of {name!r}")

    def counts(self, values: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Returns the nearest counts that the converters have; of a NaN 0, or those of an actuator's zero."""
        array = np.asarray(values, dtype=np.float64)
        if self.is_output:
            exact = self.gain * np.where(np.isnan(array), 0.0, array) + self.offset
        else:
            exact = (array - self.offset) / self.gain
        exact = np.where(np.isnan(exact), 0.0, exact)
        return np.floor(np.clip(exact, 0.0, 2.0**self.bits - 1.0) + 0.5).astype(np.int64)

    def values(self, counts: npt.ArrayLike) -> Array:
        """Returns the values of counts, in rad, N, N m or m."""
        array = np.asarray(counts, dtype=np.float64)
        return (array - self.offset) / self.gain if self.is_output else self.gain * array + self.offset


class Hand:
    """A hand: its joints, its kinematics, and the motions that its master makes of texts."""

    def __init__(self, inner: _condor.Hand) -> None:
        self._inner = inner
        joints = inner.joints()
        self.joints: list[str] = [name for name, _, _ in joints]
        """The names of the joints, `finger.joint`, in their order."""
        self.limits: npt.NDArray[np.float64] = np.array([(low, high) for _, low, high in joints])
        """The least and the greatest position of each joint, rad; shape (joints, 2)."""
        wires = inner.wires()
        self.inputs: Wires = _wires(wires, False)
        """The channels of the sensors."""
        self.outputs: Wires = _wires(wires, True)
        """The channels of the actuators."""

    @staticmethod
    def read(file: Union[str, os.PathLike[str]]) -> Hand:
        """Reads the configuration in a file of TOML. An error says in which line what is wrong."""
        try:
            text = Path(file).read_text(encoding="utf-8")
        except OSError as error:
            raise Error(f"cannot read {os.fspath(file)}: {error.strerror}") from error
        return Hand.parse(text, file=os.fspath(file))

    @staticmethod
    def parse(text: str, *, file: str = "hand") -> Hand:
        """Reads the text of a configuration; `file` is its name in errors."""
        return Hand(_condor.Hand(text, file))

    @property
    def name(self) -> str:
        """The name of the hand."""
        return self._inner.name()

    def positions(self, positions: Positions = None) -> npt.NDArray[np.float64]:
        """Returns positions of all joints, rad; shape (joints,)."""
        if positions is None:
            return np.zeros(len(self.joints))
        if isinstance(positions, Mapping):
            for name in positions:
                if name not in self.joints:
                    raise Refused(f"there is no joint {name!r}; there are {', '.join(self.joints)}")
            return np.array([float(positions.get(name, 0.0)) for name in self.joints])
        array = np.asarray(positions, dtype=np.float64)
        if array.shape != (len(self.joints),):
            raise Refused(f"{self.name} has {len(self.joints)} joints, the positions have the shape {array.shape}")
        return array

    def forward(self, positions: Positions = None) -> dict[str, npt.NDArray[np.float64]]:
        """Forward kinematics: returns where each link and each tip is.

        The pose of a frame, such as `index.distal_link` or `index.tip`, is a matrix of the shape (4, 4) that takes points
        of the frame to points of the palm, m.
        """
        poses: dict[str, npt.NDArray[np.float64]] = {}
        for name, parent, translation, rotation in self._inner.frames(self.positions(positions).tolist()):
            own = np.eye(4)
            own[:3, :3] = _matrix(*rotation)
            own[:3, 3] = translation
            poses[name] = poses[parent] @ own if parent in poses else own
        return poses

    def inverse(self, frame: str, point: Union[Sequence[float], npt.NDArray[np.float64]], start: Positions = None) -> Posture:
        """Inverse kinematics: finds positions that bring the origin of a frame to a point, or as near as can be.

        `point` is in the palm, m, shape (3,). Joints that do not carry the frame stay where they are at `start`.
        """
        array = np.asarray(point, dtype=np.float64)
        if array.shape != (3,):
            raise Refused(f"a point has the shape (3,), not {array.shape}")
        found = json.loads(self._inner.inverse(frame, tuple(array), self.positions(start).tolist()))
        held = {one["joint"]: one["limit"] for one in found["held"]}
        return Posture(np.array(found["positions"]), found["is_reached"], found["distance_m"], held)

    def clearances(self, positions: Positions = None) -> list[Clearance]:
        """Returns how near parts are to each other that must not meet."""
        return [_clearance(one) for one in json.loads(self._inner.clearances(self.positions(positions).tolist()))]

    def plan(self, motion: str, start: Positions = None, *, file: str = "motion") -> Plan:
        """Returns the motion that the hand makes of the text of a motion file, from rest at `start`.

        `file` is the name of the text in errors. Sensors read nothing: no condition of a contact or a torque holds.
        """
        period, joints, rest = self._inner.plan(self.positions(start).tolist(), motion, file)
        position, velocity, acceleration, torque = (
            np.column_stack([np.frombuffer(of[kind], "<f8") for _, of in joints]) for kind in range(4)
        )
        told = json.loads(rest)
        events = [Event(it["at_s"], it["step"], it["what"], it.get("reason")) for it in told["events"]]
        collisions = [Collision(it["from_s"], it["to_s"], _clearance(it)) for it in told["collisions"]]
        return Plan(
            joints=[name for name, _ in joints],
            time=np.arange(len(position), dtype=np.float64) * np.float64(period),
            position=position,
            velocity=velocity,
            acceleration=acceleration,
            torque=torque,
            events=events,
            overloads=[Overload(**it) for it in told["overloads"]],
            collisions=collisions,
        )

    def compile(self, motion: str, *, file: str = "motion") -> bytes:
        """Returns the text of a motion file as the bytes that the hand's master reads."""
        return bytes(self._inner.compile(motion, file))

    def urdf(self) -> str:
        """Returns the hand as URDF, the XML format of ROS for robots."""
        return self._inner.urdf() or ""

    def __repr__(self) -> str:
        return f"Hand({self.name!r}, {len(self.joints)} joints)"


def _wires(wires: list[_condor.Wire], is_output: bool) -> Wires:
    own = [it for it in wires if it[2] == is_output]
    board, channel, bits = (np.array([it[of] for it in own], np.int64) for of in (3, 4, 5))
    gain, offset, at_rest = (np.array([it[of] for it in own], np.float64) for of in (6, 7, 8))
    return Wires([it[0] for it in own], [it[1] for it in own], board, channel, bits, gain, offset, at_rest, is_output)


def _clearance(one: dict[str, Any]) -> Clearance:
    return Clearance(tuple(one["parts"]), np.array(one["points"]), one["distance_m"])


def _matrix(x: float, y: float, z: float, w: float) -> npt.NDArray[np.float64]:
    """Returns the rotation of a unit quaternion; shape (3, 3)."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
