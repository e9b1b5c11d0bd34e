"""Looks at, tunes and moves the hand of the test `basics`: check.py PLACE."""

import sys

from remote import DID_NOT_RUN, NoAnswer, Refused, Remote

place = [sys.argv[1]]
with Remote("hand", "notebook", place, password="fourth", timeout=30.0) as hand:
    assert any(it["name"] == "master" for it in hand.status()["processors"])
    assert any(it["name"].endswith("index.proximal.flexor.kt") for it in hand.variables())
    gain = hand.get("index.proximal.flexor.kt")
    assert hand.set("index.proximal.flexor.kt", gain * 1.25, before=gain) == gain
    assert hand.set("index.proximal.flexor.kt", gain) == gain * 1.25
    try:
        hand.set("index.proximal.flexor.kt", 2e9)
        raise SystemExit("a gain beyond its bounds was set")
    except Refused as error:
        assert "must be from" in str(error), error
    rows = hand.subscribe("/servo_a/")
    before = next(rows)
    for _ in range(100):
        lost = rows.lost
        row = next(rows)
        assert row["tick"] > before["tick"] and row["index.proximal.flexor.kt"] > 0.0, row
        assert row["tick"] - before["tick"] == 1 + rows.lost - lost, (before, row)
        before = row
    id = hand.next_id()
    hand.offer(id, "open")
    assert hand.wait(id, 60.0)["state"] == "done"
    assert hand.offer(id, "open")["state"] == "done"
    assert hand.run("no-such-motion")["state"] in DID_NOT_RUN
with Remote("hand", "desk", place, password="other", timeout=1.0) as desk:
    try:
        desk.run("open", timeout=1.0)
        raise SystemExit("desk has moved the hand")
    except (NoAnswer, Refused):
        pass
print("checked by a client in Python")
