"""Looks at, tunes and moves the hand of the test `basics`: check.py PLACE."""

import sys
import types
from pathlib import Path

# The package as it is in the tree: this part of it does without the native one, so that it need not be built.
package = types.ModuleType("condor")
package.__path__ = [str(Path(__file__).resolve().parents[2] / "python" / "python" / "condor")]
sys.modules["condor"] = package

from condor.remote import NoAnswer, Refused, Remote

place = [sys.argv[1]]
with Remote("hand", "notebook", place, password="fourth", timeout=30.0) as hand:
    assert any(it["name"] == "master" for it in hand.status()["processors"])
    assert any(it["name"].endswith("index.proximal-flexor.gains.kp") for it in hand.variables())
    gain = hand.get("index.proximal-flexor.gains.kp")
    assert hand.set("index.proximal-flexor.gains.kp", gain * 1.25, before=gain) == gain
    assert hand.set("index.proximal-flexor.gains.kp", gain) == gain * 1.25
    try:
        hand.set("index.proximal-flexor.gains.kp", 2e9)
        raise SystemExit("a gain beyond its bounds was set")
    except Refused as error:
        assert "must be from" in str(error), error
    rows = hand.subscribe("/servo_a/")
    before = next(rows)
    for _ in range(100):
        lost = rows.lost
        row = next(rows)
        assert row["tick"] > before["tick"] and row["index.proximal-flexor.gains.kp"] > 0.0, row
        assert row["tick"] - before["tick"] == 1 + rows.lost - lost, (before, row)
        before = row
    id = hand.next_id()
    hand.offer(id, "open")
    assert hand.wait(id, 60.0).is_done
    assert hand.offer(id, "open").is_done
    assert hand.run("no-such-motion").did_not_run
with Remote("hand", "desk", place, password="other", timeout=1.0) as desk:
    try:
        desk.run("open", timeout=1.0)
        raise SystemExit("desk has moved the hand")
    except (NoAnswer, Refused):
        pass
print("checked by a client in Python")
