"""Runs all tests. Each that passes is a line `kept`.

UTAH_MIT_HAND is the program of the hand, by default that of the tree's `target/debug`.
"""

from __future__ import annotations

import sys
import unittest
from pathlib import Path


class Result(unittest.TextTestResult):
    def addSuccess(self, test: unittest.TestCase) -> None:
        super().addSuccess(test)
        print(f"{test.id()}\nkept", flush=True)


def main() -> int:
    tests = unittest.defaultTestLoader.discover(str(Path(__file__).parent))
    result = unittest.TextTestRunner(resultclass=Result).run(tests)  # type: ignore[arg-type]
    return 0 if result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
