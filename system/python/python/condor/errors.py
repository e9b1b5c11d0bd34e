"""The exceptions of this package. Their texts are those that the commands of `condor` print."""

from __future__ import annotations


class Error(Exception):
    """An error of a system or of a hand; all others are subclasses of it."""


class TimedOut(Error, TimeoutError):
    """Something has not come, or has not been answered, within a timeout."""


class NotFound(Error, LookupError):
    """There is no system, processor, vector, variable, cell or queue of this name."""


class Refused(Error, ValueError):
    """A value, a text or a request is wrong or not possible; the message says what would be right."""
