"""Looks at the page of `view` and `sim` with a browser while the hand grasps a ball.

    python3 page.py UTAH-MIT-HAND AXE.JS PICTURES

Chromium is driven by its chromedriver. Prints each thing that holds, and `kept`, and writes pictures of the page
into the directory PICTURES. AXE.JS is the file of axe-core, which finds violations of WCAG 2 A and AA.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import simulator
from browser import SCREENS, Browser, keep, until

PARAMETER = "index.proximal.servo.bandwidth_hz"
# Of the session of a grasp: what is typed, and what the master then says.
GRASP = [("", "wave is done"), ("run grasp", "grasp is done"), ("ball", "ball"), ("grasp 150", "grasp 150")]
CURVES = ["index.proximal.position", "index.proximal-flexor.effort", "thumb.proximal-flexor.effort"]
RIGHT, ENTER = "\ue014", "\ue007"


class System:
    """The hand, the server of its page, and its master's terminal."""

    def __init__(self, condor, place):
        self.condor = condor
        self.environment = os.environ | {"XDG_RUNTIME_DIR": place}
        self.up = self.start("--headless")
        until("the system", lambda: self.ran("vars", "get", PARAMETER))
        self.view = self.start("view", "--port", "0", stdout=subprocess.PIPE)
        words = [self.view.stdout.readline().split()[0].decode() for _ in range(2)]
        self.looking, self.setting = words
        self.tty = self.start("tty", "master", stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        os.set_blocking(self.tty.stdout.fileno(), False)
        self.said = ""

    def start(self, *arguments, **options):
        options = {"stdin": subprocess.DEVNULL, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL} | options
        return subprocess.Popen([self.condor, *arguments], env=self.environment, **options)

    def ran(self, *arguments):
        done = subprocess.run([self.condor, *arguments], env=self.environment, capture_output=True, check=False)
        return done.stdout.decode() if done.returncode == 0 else None

    def get(self, name):
        return json.loads(self.ran("vars", "get", name, "--json"))

    def number(self, name):
        """Returns the present value of a variable, as the command line sees it."""
        return next(iter(find(self.get(name), "value")))

    def type(self, text, answer):
        if text:
            self.tty.stdin.write(f"{text}\n".encode())
            self.tty.stdin.flush()

        def is_said():
            self.said += (self.tty.stdout.read() or b"").decode()
            return answer in self.said

        until(f"{answer} of {text}", is_said)

    def end(self):
        for program in (self.tty, self.view, self.up):
            program.terminate()
            program.wait()


def find(tree, key):
    """Yields what stands under a key anywhere in JSON."""
    if isinstance(tree, dict):
        if key in tree:
            yield tree[key]
        for child in tree.values():
            yield from find(child, key)
    elif isinstance(tree, list):
        for child in tree:
            yield from find(child, key)


def slider(browser, system):
    """Moves the slider of a parameter by the keyboard alone."""
    browser.type("#parameter-filter", PARAMETER)
    range_of = "#sliders input[type=range]:enabled"
    until("the slider", lambda: browser.run(f"document.querySelector('{range_of}') !== null"))
    before = system.number(PARAMETER)
    browser.type(range_of, RIGHT * 3)
    step = browser.run(f"Number(document.querySelector('{range_of}').step)")
    until("the parameter", lambda: abs(system.number(PARAMETER) - before - 3 * step) < 1e-6 * before)
    after = system.number(PARAMETER)
    shown = "Number(document.querySelector('#sliders input[type=number]').value)"
    until("the field", lambda: abs(browser.run(shown) - after) < 1e-3)
    keep(f"a slider that is moved by keys sets {PARAMETER} from {before} to {after}")


def turned(browser):
    """Turns the robot by keys."""
    picture = "document.getElementById('figure').toDataURL()"
    before = browser.run(picture)
    browser.type("#figure", RIGHT * 6)
    until("another picture", lambda: browser.run(picture) != before)
    keep("arrow keys turn the robot")


def opened(browser, url):
    """Opens the page, and waits until it shows the hand."""
    browser.open(url)
    values = "document.querySelectorAll('#rows .number').length"
    until("values", lambda: browser.run(values) > 20)
    until("a picture", lambda: not browser.run("document.getElementById('tensions').hidden"))


def look(browser, system, axe, pictures):
    browser.show("desktop", "light")
    opened(browser, system.looking)
    assert "only looks" in browser.run("document.getElementById('state').textContent")
    assert browser.run("[...document.querySelectorAll('#sliders input')].every(it => it.disabled)")
    keep("without the token the page only looks, and says so")
    opened(browser, system.setting)
    assert browser.run("location.hash") == "" and "token" not in browser.run("location.href")
    changes = "document.getElementById('rows').textContent"
    before = browser.run(changes)
    until("other values", lambda: browser.run(changes) != before)
    keep("values arrive, and the token leaves the address")
    slider(browser, system)
    turned(browser)
    for text, answer in GRASP:
        system.type(text, answer)
    held = "document.getElementById('objects').textContent"
    until("the ball held by all fingers, with their forces", lambda: browser.run(held).count(" N") == 4)
    keep(f"the page says: {browser.run(held)}")
    for scheme in ("light", "dark"):
        for screen in SCREENS:
            browser.show(screen, scheme)
            opened(browser, system.looking)
            # A reload loses none.
            for name in CURVES:
                if not browser.run(f"document.getElementById('panes').textContent.includes('{name}')"):
                    browser.type("#variable", f"{name}{ENTER}")
            until("curves", lambda: browser.run("document.querySelectorAll('.curves li').length") > len(CURVES))
            browser.check(axe)
            # As somebody sees it who has looked for some seconds.
            browser.run("void (document.activeElement.blur(), scrollTo({top: 0, behavior: 'instant'}))")
            time.sleep(6)
            browser.photograph(pictures / f"page-{screen}-{scheme}.png")
            keep(f"axe-core finds no violation on a {screen} in the {scheme} scheme")
    browser.show("phone", "light", "reduce")
    opened(browser, system.looking)
    assert browser.run("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    keep("with reduced motion the page shows its values, too")
    late = "document.getElementById('late').textContent"
    assert browser.run(late) == ""
    system.ran("stop", "table")
    until("the table is late", lambda: "Nothing comes from table/" in browser.run(late))
    system.ran("start", "table")
    until("the table is there again", lambda: browser.run(late) == "")
    keep("what comes from a stopped program is not shown as if it were new")
    complaints = browser.complaints()
    assert not complaints, complaints
    keep("nothing stands in the console")


def main(condor, axe, pictures):
    condor, axe, pictures = str(Path(condor).resolve()), Path(axe).read_text(), Path(pictures)
    pictures.mkdir(parents=True, exist_ok=True)
    browser = Browser()
    try:
        simulator.look_alone(browser, condor, axe)
        with tempfile.TemporaryDirectory() as place:
            system = System(condor, place)
            try:
                look(browser, system, axe, pictures)
                simulator.look_beside(browser, system, axe, pictures)
            finally:
                system.end()
    finally:
        browser.end()


if __name__ == "__main__":
    main(*sys.argv[1:])
