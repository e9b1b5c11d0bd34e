"""Running systems and hands of Condor.

`join` visits a running system: its processors, messages, variables and parameters, published cells, terminals and
motions. `Hand` is a hand as its configuration describes it, without any processor. Every wait has a time-out in
seconds, and lets other threads of Python run. Errors are subclasses of `Error`.
"""

from .errors import Error, NotFound, Refused, TimedOut
from .hand import Clearance, Collision, Event, Hand, Overload, Plan, Posture
from .motions import Motion, Outcome
from .samples import Samples, Series
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
    "Clearance",
    "Clock",
    "Collision",
    "Error",
    "Event",
    "Hand",
    "Loop",
    "Motion",
    "NotFound",
    "Outcome",
    "Overload",
    "Plan",
    "Posture",
    "Processor",
    "Published",
    "Refused",
    "Samples",
    "Series",
    "System",
    "Terminal",
    "TimedOut",
    "Variable",
    "Vector",
    "Watch",
    "join",
    "running",
]
