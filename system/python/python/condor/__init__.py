"""Running systems, robots and hands of Condor.

`join` visits a running system: its processors, messages, variables and parameters, published cells, terminals and
motions; `up` brings one up. `Simulator` is a robot at the other side of the boards, `Rack` those of a hand. `Hand` is a
hand as its configuration describes it, without any processor. Every wait has a timeout in
seconds, and lets other threads of Python run. Errors are subclasses of `Error`.
"""

from .bringing_up import up
from .errors import Error, NotFound, Refused, TimedOut
from .hand import Clearance, Collision, Event, Hand, Overload, Plan, Posture, Wires
from .motions import Motion, Outcome
from .rack import Commands, Rack
from .samples import Samples, Series
from .simulator import Bus, Parameter, Shown, Simulator
from .system import (
    Clock,
    Loop,
    Processor,
    Published,
    System,
    Terminal,
    Variable,
    Vector,
    Watch,
    join,
    running,
)

__all__ = [
    "Bus",
    "Clearance",
    "Clock",
    "Collision",
    "Commands",
    "Error",
    "Event",
    "Hand",
    "Loop",
    "Motion",
    "NotFound",
    "Outcome",
    "Overload",
    "Parameter",
    "Plan",
    "Posture",
    "Processor",
    "Published",
    "Rack",
    "Refused",
    "Samples",
    "Series",
    "Shown",
    "Simulator",
    "System",
    "Terminal",
    "TimedOut",
    "Variable",
    "Vector",
    "Watch",
    "Wires",
    "join",
    "running",
    "up",
]
