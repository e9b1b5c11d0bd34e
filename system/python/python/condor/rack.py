"""The robot's side of a rack of converters and counters, whose wires are in the configuration of a hand."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Optional

import numpy as np
import numpy.typing as npt

from .errors import Refused
from .hand import Hand, Wires
from .simulator import Bus, Simulator

Array = npt.NDArray[np.float64]

LINES = 16
"""The channels of a converter board."""
COUNTERS = 8
"""The channels of an encoder board."""

_IDENTIFICATION, _CONTROL, _STROBE, _CHANNELS = 0x00, 0x02, 0x04, 0x20
_ADC, _DAC, _ENCODER = 0xADC0, 0xDAC0, 0xE4C0
_CONNECTED = 1


class Commands(NamedTuple):
    """What the actuators of a hand are told."""

    effort: Array
    """The efforts of the actuators in the order of the configuration, N or N m: of a tendon its tension; shape
    (actuators,)."""
    force: Array
    """The forces of the axes of the table, N; shape (axes,)."""


class Rack:
    """The boards of a hand, from the robot's side: it reads what actuators are told, and writes what sensors say.

    The boards are those of `system/boards/rack`: A/D and D/A boards of 16 channels and one encoder board. A
    board of the configuration is a slot, which has two converter boards; the channels of the slot `encoder_slot` are the
    counters of the encoder board. Calibrations and widths are those of the configuration.

    A D/A board that is not strobed for `watchdog_s`, or that no program has open, takes its outputs to
    rest within `ramp_s`. In simulated time all is as with the simulated robot in Rust.
    """

    def __init__(
        self,
        simulator: Simulator,
        hand: Hand,
        *,
        adc: Sequence[int] = (0x0000, 0x0100, 0x0200, 0x0300),
        dac: Sequence[int] = (0x1000, 0x1100, 0x1200, 0x1300, 0x1400, 0x1500),
        encoder: int = 0x2000,
        encoder_slot: int = 2,
        watchdog_s: float = 0.025,
        ramp_s: float = 0.25,
    ) -> None:
        self._bus = simulator.bus
        self._adc, self._dac, self._encoder = list(adc), list(dac), encoder
        self._inputs, self._outputs = hand.inputs, hand.outputs
        is_counter = self._inputs.board == encoder_slot
        self._converted = np.flatnonzero(~is_counter)
        self._counted = np.flatnonzero(is_counter)
        place = _places(self._inputs, len(adc), self._converted)
        self._input_places = place
        self._counter_places = self._inputs.channel[self._counted]
        if (self._counter_places >= COUNTERS).any():
            raise Refused(f"an encoder board has {COUNTERS} counters")
        self._used = sorted({int(at) // LINES for at in place})
        self._image = np.zeros((len(adc), LINES), np.uint16)
        self._counters = np.zeros(COUNTERS, np.uint32)
        places = _places(self._outputs, len(dac), np.arange(len(self._outputs)))
        ticks = [max(1, int(s * simulator.rate_hz)) for s in (watchdog_s, ramp_s)]
        self._boards = [
            _OutputBoard(self._bus, base, self._outputs, np.flatnonzero(places // LINES == number), places, *ticks)
            for number, base in enumerate(dac)
        ]
        self._values = self._outputs.at_rest.copy()
        self._actuators = self._outputs.of("actuator")
        commanded = [self._outputs.names[wire] for wire in self._actuators]
        self._sensed = self._inputs.of("actuator")
        self._measured = [commanded.index(self._inputs.names[wire]) for wire in self._sensed]
        self._stuck: dict[int, int] = {}
        self._last = np.zeros(len(self._inputs), np.int64)
        self.unplug()

    def plug(self) -> None:
        """Lets the boards answer; do this when the sensors show what they should."""
        self._identify(_ADC, _DAC, _ENCODER)

    def unplug(self) -> None:
        """Lets no board answer, and forgets strobes of a former program."""
        self._identify(0, 0, 0)
        for base in self._dac:
            self._bus.write(base + _STROBE, 0)

    def _identify(self, adc: int, dac: int, encoder: int) -> None:
        for bases, identification in ((self._adc, adc), (self._dac, dac), ([self._encoder], encoder)):
            for base in bases:
                self._bus.write(base + _IDENTIFICATION, identification)

    def commands(self) -> Commands:
        """Returns what the actuators are told in this step. Call it once in each step."""
        for board in self._boards:
            board.update(self._values)
        axis = self._outputs.of("axis")
        return Commands(self._values[self._actuators], self._values[axis])

    @property
    def resting(self) -> list[bool]:
        """Whether the outputs of each D/A board are those of its watchdog."""
        return [board.is_resting for board in self._boards]

    def show(
        self,
        *,
        position: npt.ArrayLike,
        effort: npt.ArrayLike,
        axis: Optional[npt.ArrayLike] = None,
        touch: Optional[npt.ArrayLike] = None,
    ) -> None:
        """Writes what the sensors say: each converts its value to counts, as its calibration and width are.

        `position` are those of the joints, rad, shape (joints,); `effort` those of the actuators as in `Commands`, N or
        N m, of which those without a sensor are not measured; `axis` those of the table's axes, m; `touch` the forces
        at the fingertips that have a sensor, N. What is not given stays.
        """
        values = self._inputs.values(self._last)
        given = {"position": position, "axis": axis, "touch": touch}
        for kind, of_kind in given.items():
            if of_kind is not None:
                values[self._inputs.of(kind)] = of_kind
        values[self._sensed] = np.broadcast_to(effort, self._actuators.shape)[self._measured]
        counts = self._inputs.counts(values)
        for wire, stuck in self._stuck.items():
            counts[wire] = stuck
        self._last = counts
        self._image.reshape(-1)[self._input_places] = counts[self._converted]
        for board in self._used:
            self._bus.write(self._adc[board] + _CHANNELS, self._image[board])
        if len(self._counted):
            self._counters[self._counter_places] = counts[self._counted]
            self._bus.write(self._encoder + _CHANNELS, self._counters, width=4)

    def stick(self, kind: str, name: str) -> None:
        """Has a sensor show from now on what it shows now: `kind` is as in `Wires`, `name` too."""
        wire = self._inputs.index(kind, name)
        self._stuck[wire] = int(self._last[wire])

    def mend(self) -> None:
        """Has all sensors show again what they measure."""
        self._stuck.clear()


class _OutputBoard:
    """A D/A board with its watchdog."""

    def __init__(
        self,
        bus: Bus,
        base: int,
        outputs: Wires,
        own: npt.NDArray[np.intp],
        places: npt.NDArray[np.int64],
        patience: int,
        ramp: int,
    ) -> None:
        self._bus, self._base, self._own = bus, base, own
        self._lines = places[own] % LINES
        self._offset, self._gain = outputs.offset[own], outputs.gain[own]
        self._zero = outputs.counts(np.zeros(len(outputs)))[own]
        self._at_rest = outputs.at_rest[own]
        self._asked, self._from = self._at_rest, self._at_rest
        self._patience, self._ramp = patience, ramp
        self._ticks, self._state = 0, "new"

    @property
    def is_resting(self) -> bool:
        return self._state != "refreshed"

    def update(self, values: Array) -> None:
        """One step: its own values among those of all outputs, N or N m."""
        if not len(self._own):
            return
        self._ticks += 1
        control, strobe = self._bus.read(self._base + _CONTROL, 2)
        if not control & _CONNECTED:
            if self._state == "refreshed":
                self._rest()
        elif strobe:
            # Before the channels: what is strobed while they are read, is read again.
            self._bus.write(self._base + _STROBE, 0)
            registers = self._bus.read(self._base + _CHANNELS, LINES).astype(np.int16)[self._lines]
            counts = np.maximum(self._zero + registers, 0)
            # 0 V is nothing, also where no whole number of counts is.
            self._asked = np.where(registers == 0, 0.0, (counts - self._offset) / self._gain)
            self._ticks, self._state = 0, "refreshed"
        elif self._state == "refreshed" and self._ticks >= self._patience:
            self._rest()
        if self._state == "new":
            values[self._own] = self._at_rest
        elif self._state == "refreshed":
            values[self._own] = self._asked
        else:
            part = min(self._ticks / self._ramp, 1.0)
            values[self._own] = self._from + (self._at_rest - self._from) * part

    def _rest(self) -> None:
        self._from, self._ticks, self._state = self._asked, 0, "rests"


def _places(wires: Wires, boards: int, chosen: npt.NDArray[np.intp]) -> npt.NDArray[np.int64]:
    """Returns the places of wires among all lines of the converter boards; a slot has two boards."""
    board, channel = wires.board[chosen], wires.channel[chosen]
    wrong = (channel >= 2 * LINES) | (board >= boards // 2)
    if wrong.any():
        first = int(np.flatnonzero(wrong)[0])
        raise Refused(f"the rack has no board {board[first]} that has a channel {channel[first]}")
    return board * (2 * LINES) + channel
