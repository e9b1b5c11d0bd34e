"""Checks of the simulator of the page: with a running hand, and without any processor."""

import json
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from browser import SCREENS, keep, until

HAND = Path(__file__).resolve().parents[3] / "condor-hand" / "hands" / "utah-mit.toml"
# What the checks save, among the texts of the hand.
SAVED = Path(__file__).resolve().parents[1] / "motions" / "of-the-page.toml"
SECTION = "#simulator"
LEFT, UP, RIGHT, DOWN, PAGE_DOWN = "\ue012", "\ue013", "\ue014", "\ue015", "\ue00f"
SHIFT, CONTROL = "\ue008", "\ue009"
NOWHERE = {"stdin": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
JOINT, TIP = "index.proximal", "index.tip"
TARGET = 0.8
# Index finger and thumb come from two sides to the same place.
MEETING = """[[motion]]
profile = "minimum-jerk"
duration = 1.0
[motion.to]
"index.proximal" = 0.6
"index.middle" = 1.2
"index.distal" = 1.2
"thumb.proximal" = 0.6
"thumb.middle" = 1.2
"thumb.distal" = 1.2
"""
# Finds a handle by its cursor; returns where it is.
OVER = """(() => {
    const canvas = document.getElementById("sim-figure");
    const box = canvas.getBoundingClientRect();
    for (let y = 4; y < Math.min(box.height, innerHeight - box.top); y += 6) for (let x = 4; x < box.width; x += 6) {
        const at = {clientX: box.left + x, clientY: box.top + y, pointerType: "mouse"};
        canvas.dispatchEvent(new PointerEvent("pointermove", at));
        if (canvas.classList.contains("is-over")) return [at.clientX, at.clientY];
    }
    return null;
})()"""


class Alone:
    """The server of the page for a robot without any processor."""

    def __init__(self, condor, place, robot, port=0):
        command = [condor, "sim", str(robot), "--port", str(port)]
        environment = os.environ | {"XDG_RUNTIME_DIR": place}
        self.program = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, **NOWHERE)
        words = [self.program.stdout.readline().split()[0].decode() for _ in range(2)]
        self.looking, self.setting = words
        self.port = int(re.search(r":(\d+)/", self.looking)[1])

    def end(self):
        self.program.terminate()
        self.program.wait()


def opened(browser, url):
    """Opens the page, and waits until it shows the simulator."""
    browser.open(url)
    until("the simulator", lambda: browser.run("document.querySelectorAll('#sim-joints input').length") > 20)
    until("a posture", lambda: position(browser, JOINT) is not None)
    until("tips", lambda: browser.run("Number(document.getElementById('sim-x').value)"))


def field_of(joint):
    """Returns the script that finds the field of a joint."""
    return f"""[...document.querySelectorAll("#sim-joints .parameter")]
        .find(it => it.querySelector("input[type=range]").ariaLabel === "{joint}").querySelector("input[type=number]")"""


def position(browser, joint):
    text = browser.run(f"{field_of(joint)}.value")
    return float(text) if text else None


def place(browser):
    """Returns where the chosen tip is, in mm."""
    return [float(browser.value(f"#sim-{axis}")) for axis in "xyz"]


def set_joint(browser, joint, value):
    browser.run(f"""void (() => {{
        const field = {field_of(joint)};
        field.value = {value};
        field.dispatchEvent(new Event("change"));
    }})()""")


def write(browser, text):
    """Writes the text of the motion, as somebody does who pastes it."""
    browser.run("document.getElementById('sim-source').open = true")
    browser.run(f"""void (() => {{
        const area = document.getElementById("sim-text");
        area.value = {json.dumps(text)};
        area.dispatchEvent(new Event("input", {{bubbles: true}}));
    }})()""")


def planned(browser, text):
    until(f"the plan: {text}", lambda: text in browser.text("#sim-plan-said"))


def press(browser, *keys):
    """Presses keys together, where the focus is."""
    down = [{"type": "keyDown", "value": key} for key in keys]
    up = [{"type": "keyUp", "value": key} for key in reversed(keys)]
    browser.ask("POST", "/actions", actions=[{"type": "key", "id": "keys", "actions": down + up}])


def moves(browser):
    """Moves joints and tips by keys and by the pointer."""
    slider = f"#sim-joints input[type=range][aria-label='{JOINT}']"
    before = position(browser, JOINT)
    browser.type(slider, RIGHT * 5)
    until("the joint", lambda: abs(position(browser, JOINT) - before - 0.05) < 0.011)
    set_joint(browser, JOINT, 0.3)
    until("the slider", lambda: abs(float(browser.value(slider)) - 0.3) < 0.006)
    keep(f"a slider and a field move {JOINT}")
    set_joint(browser, JOINT, 9)
    until("the limit", lambda: f"{JOINT} is at its limit" in browser.text("#sim-held"))
    keep(f"the page says: {browser.text('#sim-held')}")
    set_joint(browser, JOINT, 0.3)

    browser.click("#sim-handles button")
    assert browser.text("#sim-handles [aria-pressed=true]") == TIP
    until("rest", lambda: browser.text("#sim-held") == "")
    before = place(browser)
    browser.type("#sim-handles button", PAGE_DOWN * 5)
    until("the tip", lambda: distance(place(browser), before) > 3)
    keep(f"keys bring {TIP} from {before} to {place(browser)} mm")
    press_away(browser)

    browser.see(".halves")
    over = until("a handle", lambda: browser.run(OVER))
    before = browser.text("#sim-now"), browser.run("document.getElementById('sim-joints').innerHTML.length"), values(browser)
    browser.drag(over, (12, 8))
    until("joints that follow", lambda: values(browser) != before[2])
    keep("the pointer drags a tip, and joints follow")
    browser.drag(browser.run(OVER), (-400, -300))
    until("what holds it", lambda: " mm from there: " in browser.text("#sim-held"))
    keep(f"the page says: {browser.text('#sim-held')}")


def press_away(browser):
    """Moves the tip by a long way with Shift."""
    before = place(browser)
    browser.run("void document.querySelector('#sim-handles button').focus()")
    press(browser, SHIFT, UP)
    until("the tip", lambda: distance(place(browser), before) > 5)
    keep("with Shift a key moves it by 10 mm")


def values(browser):
    return browser.run("[...document.querySelectorAll('#sim-joints input[type=number]')].map(it => it.value)")


def distance(one, other):
    return sum((a - b) ** 2 for a, b in zip(one, other)) ** 0.5


def composes(browser):
    """Composes a motion of two steps from postures, and looks at its plan."""
    browser.click("#sim-rest")
    set_joint(browser, JOINT, 0.5)
    until("the posture", lambda: position(browser, JOINT) == 0.5)
    browser.click("#sim-add")
    until("a step", lambda: steps(browser) == 1)
    set_joint(browser, JOINT, 0.2)
    set_joint(browser, "thumb.proximal", 0.3)
    until("the posture", lambda: position(browser, "thumb.proximal") == 0.3)
    browser.click("#sim-add")
    until("two steps", lambda: steps(browser) == 2)
    planned(browser, "The motion takes 2.00 s: the robot can make it, and nothing meets.")
    assert '"index.proximal" = 0.2' in browser.value("#sim-text") or "0.2" in browser.value("#sim-text")
    rows = browser.run("document.querySelectorAll('#sim-peaks tr').length")
    assert rows == 16, rows
    assert browser.run("document.querySelectorAll('#sim-curves canvas').length") >= 4
    keep("a motion of two steps is composed from postures; its plan has a table and curves")
    browser.run("void document.querySelector('#sim-steps summary').click()")
    field = "#sim-steps input"
    browser.run(f"void (document.querySelector('{field}').value = 0.5)")
    browser.run(f"void document.querySelector('{field}').dispatchEvent(new Event('change'))")
    planned(browser, "The motion takes 1.50 s")
    browser.run("void document.querySelector('[data-key=\"0 later\"]').click()")
    until("the other order", lambda: "thumb.proximal" in browser.text("#sim-steps summary"))
    keep("the pace and the order of steps change")
    browser.click("#sim-undo")
    until("the order before", lambda: "thumb.proximal" not in browser.text("#sim-steps summary"))
    browser.run("document.activeElement.blur()")
    press(browser, CONTROL, "z")
    planned(browser, "The motion takes 2.00 s")
    press(browser, CONTROL, SHIFT, "z")
    planned(browser, "The motion takes 1.50 s")
    keep("changes are undone, and done again, by buttons and keys")


def steps(browser):
    return browser.run("document.querySelectorAll('#sim-steps li').length")


def plays(browser):
    set_joint(browser, JOINT, 1.0)
    until("the posture", lambda: position(browser, JOINT) == 1.0)
    browser.click("#sim-play")
    until("the end", lambda: browser.text("#sim-play") == "Play" and position(browser, JOINT) == 0.2)
    keep("the motion is played to its end")
    browser.click("#sim-undo")
    until("the posture before", lambda: position(browser, JOINT) == 1.0)
    keep("undo returns to the posture before")
    browser.type("#sim-time", LEFT * 10)
    until("another time", lambda: position(browser, JOINT) != 1.0)
    keep("the slider of time shows the motion, too")


def warns(browser):
    browser.click("#sim-from-rest")
    write(browser, MEETING)
    until("a warning", lambda: " meet, " in browser.text("#sim-warnings"))
    keep(f"the page warns: {browser.text('#sim-warnings li')}")
    write(browser, MEETING.replace("minimum-jerk", "brisk"))
    until("the mistake", lambda: "brisk" in browser.text("#sim-text-trouble"))
    keep("a mistake in the text is told")
    write(browser, MEETING)
    until("no mistake", lambda: not browser.text("#sim-text-trouble"))


def survives(browser, url):
    """Reloads the page."""
    set_joint(browser, JOINT, 0.77)
    until("the posture", lambda: position(browser, JOINT) == 0.77)
    text = browser.value("#sim-text")
    opened(browser, url)
    until("the posture", lambda: position(browser, JOINT) == 0.77)
    assert browser.value("#sim-text") == text
    until("a plan", lambda: " meet, " in browser.text("#sim-warnings"))
    assert not browser.run("document.getElementById('sim-undo').disabled")
    keep("a reload loses nothing, not even what can be undone")


def files(browser):
    """Saves a motion, and opens it again."""
    text = browser.value("#sim-text")
    browser.run(f"void (document.getElementById('sim-name').value = '{SAVED.name}')")
    browser.click("#sim-save")
    until("the file", lambda: f"{SAVED.name} is saved" in browser.text("#sim-file-said"))
    write(browser, "")
    until("no step", lambda: steps(browser) == 0)
    browser.click("#sim-save")
    until("the refusal", lambda: browser.run("document.getElementById('sim-file-said').className") == "bad")
    keep(f"the page says: {browser.text('#sim-file-said')}")
    browser.click("#sim-open")
    until("the text", lambda: browser.value("#sim-text") == text)
    keep("a motion is saved, not replaced unless asked, and opened again")


def look_alone(browser, condor, axe):
    """Looks at the page of a robot without any processor, whose server is started twice."""
    with tempfile.TemporaryDirectory() as directory:
        robot = Path(directory) / HAND.name
        shutil.copy(HAND, robot)
        server = Alone(condor, directory, robot)
        try:
            browser.show("desktop", "light")
            opened(browser, server.looking)
            assert browser.run("document.getElementById('sim-save').disabled")
            assert "#token=" in browser.text("#sim-trust")
            keep("without the token nothing is saved, and the page says so")
            opened(browser, server.setting)
            assert browser.text("#name") == HAND.name
            for section in ("robot", "log", "plots", "parameters", "values"):
                assert browser.run(f"document.getElementById('{section}').hidden"), section
            keep("without a system the page has the simulator alone")
            moves(browser)
            composes(browser)
            plays(browser)
            warns(browser)
            survives(browser, server.looking)
            files(browser)
            complaints = browser.complaints()
            assert not complaints, complaints
            keep("nothing stands in the console")
            server = restarts(browser, server, condor, directory, robot)
            browser.show("phone", "dark", "reduce")
            opened(browser, server.looking)
            assert browser.run("document.getElementById('sim-play').hidden")
            browser.check(axe)
            keep("with reduced motion nothing plays by itself")
            complaints = browser.complaints()
            assert not complaints, complaints
            # Else it would try to connect when the server has gone.
            browser.open("about:blank")
        finally:
            SAVED.unlink(missing_ok=True)
            server.end()


def restarts(browser, server, condor, directory, robot):
    """Ends the server, and starts it again; returns it."""
    text = browser.value("#sim-text")
    server.end()
    until("that it is gone", lambda: "tries again by itself" in browser.text("#state"))
    set_joint(browser, JOINT, 0.66)
    server = Alone(condor, directory, robot, server.port)
    until("the connection", lambda: "its token is refused" in browser.text("#state"))
    until("that it may not save", lambda: browser.run("document.getElementById('sim-save').disabled"))
    until("the posture", lambda: position(browser, JOINT) == 0.66 and browser.value("#sim-text") == text)
    keep("the page connects again by itself, loses nothing, and says that its token is refused")
    browser.run(f"void (location.hash = '{server.setting.split('#')[1]}')")
    until("the new token", lambda: browser.text("#state").startswith("Connected; changes are allowed"))
    until("that it may save", lambda: not browser.run("document.getElementById('sim-save').disabled"))
    keep("the new token is taken without a reload")
    # The attempts to connect stand there.
    other = [it for it in browser.complaints() if "ERR_CONNECTION" not in it and "WebSocket" not in it and "403" not in it]
    assert not other, other
    return server


def look_beside(browser, system, axe, pictures):
    """Looks at the simulator beside a running hand: takes its posture, and has it make a motion."""
    browser.show("desktop", "light")
    opened(browser, system.setting)
    until("the measured posture", lambda: not browser.run("document.getElementById('sim-ghost').hidden"))
    browser.click("#sim-measured")
    measured = system.number(f"{JOINT}.position")
    until("the measured posture", lambda: abs(position(browser, JOINT) - system.number(f"{JOINT}.position")) < 0.05)
    keep(f"the measured posture is taken, with {JOINT} at {measured:.3f} rad")
    browser.click("#sim-from-here")
    enqueues(browser, system)
    write(browser, MEETING)
    until("a warning", lambda: " meet, " in browser.text("#sim-warnings"))
    for scheme in ("light", "dark"):
        for screen in SCREENS:
            browser.show(screen, scheme)
            opened(browser, system.setting)
            until("a warning", lambda: " meet, " in browser.text("#sim-warnings"))
            browser.run("void (document.querySelector('#sim-steps details').open = true)")
            browser.type("#sim-time", RIGHT * 60)
            browser.check(axe)
            browser.run("void document.activeElement.blur()")
            browser.photograph(pictures / f"simulator-{screen}-{scheme}.png", section(browser, screen))
            keep(f"axe-core finds no violation in the simulator on a {screen} in the {scheme} scheme")
    complaints = browser.complaints()
    assert not complaints, complaints
    keep("nothing stands in the console")


def section(browser, screen):
    """Returns where the section is in the page, made smaller; on a phone, its upper part."""
    browser.run("void scrollTo({top: 0, behavior: 'instant'})")
    box = browser.run(f"document.querySelector('{SECTION}').getBoundingClientRect().toJSON()")
    width, height, is_phone = SCREENS[screen]
    height, scale = (height, 1) if is_phone else (box["height"], 0.6)
    return {"x": 0, "y": box["y"] - 12, "width": width, "height": height + 24, "scale": scale}


def enqueues(browser, system):
    system.type("release", "")
    write(browser, f'[[motion]]\nprofile = "minimum-jerk"\nduration = 1.0\n[motion.to]\n"{JOINT}" = {TARGET}\n')
    planned(browser, "The motion takes 1.00 s")
    browser.run("void (document.getElementById('sim-control').checked = true)")
    browser.click("#sim-enqueue")
    until("its end", lambda: "The motion is done" in browser.text("#sim-outcome"))
    until("the joint", lambda: abs(system.number(f"{JOINT}.position") - TARGET) < 0.02)
    keep(f"the hand makes the motion, and {JOINT} is at {system.number(f'{JOINT}.position'):.3f} rad")
