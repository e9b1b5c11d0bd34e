"""Looks at the page of `view` with a browser while the hand grasps a ball.

    python3 page.py UTAH-MIT-HAND AXE.JS PICTURES

Chromium is driven by its chromedriver. Prints each thing that holds, and `kept`, and writes pictures of the page
into the directory PICTURES. AXE.JS is the file of axe-core, which finds violations of WCAG 2 A and AA.
"""

import base64
import http.client
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PATIENCE_S = 60
PARAMETER = "index.proximal.bandwidth_hz"
SCREENS = {"desktop": (1440, 1000, False), "phone": (390, 844, True)}
# Of the session of a grasp: what is typed, and what the master then says.
GRASP = [("", "wave is done"), ("run grasp", "grasp is done"), ("ball", "ball"), ("grasp 150", "grasp 150")]
CURVES = ["index.proximal.position", "index.proximal.flexor.tension", "thumb.proximal.flexor.tension"]
RIGHT, ENTER = "\ue014", "\ue007"
WIDE = """(() => {
    const root = document.documentElement;
    if (root.scrollWidth <= root.clientWidth) return [];
    const isOut = it => it.getBoundingClientRect().right > root.clientWidth;
    return [`${root.scrollWidth} px of ${root.clientWidth}`, ...[...document.querySelectorAll("*")].filter(isOut).map(it => it.tagName)];
})()"""
AXE = "axe.run({runOnly: ['wcag2a', 'wcag2aa', 'wcag21a', 'wcag21aa', 'wcag22aa']}).then(it => done(it.violations))"


def keep(text):
    print(f"{text}\nkept", flush=True)


def until(what, look):
    """Waits until `look` returns something, and returns it."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        found = look()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f"not within {PATIENCE_S} s: {what}")


class Browser:
    """A session of chromedriver."""

    def __init__(self, port):
        self.port = port
        self.path = ""
        arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars"]
        wanted = {"goog:chromeOptions": {"args": arguments}, "goog:loggingPrefs": {"browser": "ALL"}}
        session = self.ask("POST", "/session", capabilities={"alwaysMatch": wanted})
        self.path = f"/session/{session['sessionId']}"

    def ask(self, method, path, **body):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE_S)
        connection.request(method, self.path + path, json.dumps(body) if method == "POST" else None)
        value = json.loads(connection.getresponse().read())["value"]
        if isinstance(value, dict) and "error" in value:
            raise AssertionError(f"{path}: {value['message']}")
        return value

    def run(self, script):
        """Returns the value of an expression in the page."""
        return self.ask("POST", "/execute/sync", script=f"return {script}", args=[])

    def wait(self, script):
        """Returns what `done` is called with."""
        text = f"const done = arguments[0]; {script}"
        return self.ask("POST", "/execute/async", script=text, args=[])

    def chrome(self, command, **parameters):
        return self.ask("POST", "/goog/cdp/execute", cmd=command, params=parameters)

    def find(self, selector):
        found = self.ask("POST", "/element", using="css selector", value=selector)
        return next(iter(found.values()))

    def type(self, selector, text):
        self.ask("POST", f"/element/{self.find(selector)}/value", text=text)

    def show(self, screen, scheme, motion="no-preference"):
        width, height, is_phone = SCREENS[screen]
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone}
        self.chrome("Emulation.setDeviceMetricsOverride", **size)
        features = [("prefers-color-scheme", scheme), ("prefers-reduced-motion", motion)]
        features = [{"name": name, "value": value} for name, value in features]
        self.chrome("Emulation.setEmulatedMedia", features=features)

    def open(self, url):
        self.ask("POST", "/url", url="about:blank")
        self.ask("POST", "/url", url=url)
        values = "document.querySelectorAll('#rows .number').length"
        until("values", lambda: self.run(values) > 20)
        until("a picture", lambda: not self.run("document.getElementById('tensions').hidden"))

    def complaints(self):
        return [entry["message"] for entry in self.ask("POST", "/se/log", type="browser")]


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


def value(system):
    """Returns the present value of the parameter, as the command line sees it."""
    return next(iter(find(system.get(PARAMETER), "value")))


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
    range_of = "#sliders input[type=range]"
    until("the slider", lambda: browser.run(f"document.querySelector('{range_of}')?.value > 0"))
    before = value(system)
    browser.type(range_of, RIGHT * 3)
    step = browser.run(f"Number(document.querySelector('{range_of}').step)")
    until("the parameter", lambda: abs(value(system) - before - 3 * step) < 1e-6 * before)
    after = value(system)
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


def check(browser, axe):
    """Finds no violation, and nothing that is wider than the screen."""
    browser.run(f"void (() => {{ {axe} }})()")
    violations = browser.wait(AXE)
    told = [f"{it['id']}: {[node['target'] for node in it['nodes']]}" for it in violations]
    assert not told, told
    wide = browser.run(WIDE)
    assert not wide, f"the page is too wide: {wide}"


def look(browser, system, axe, pictures):
    browser.show("desktop", "light")
    browser.open(system.looking)
    assert "only looks" in browser.run("document.getElementById('state').textContent")
    assert browser.run("[...document.querySelectorAll('#sliders input')].every(it => it.disabled)")
    keep("without the token the page only looks, and says so")
    browser.open(system.setting)
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
    until("the ball held by all fingers", lambda: browser.run(held).count(",") >= 5)
    keep(f"the page says: {browser.run(held)}")
    pictures.mkdir(parents=True, exist_ok=True)
    for scheme in ("light", "dark"):
        for screen in SCREENS:
            browser.show(screen, scheme)
            browser.open(system.looking)
            # A reload loses none.
            for name in CURVES:
                if not browser.run(f"document.getElementById('panes').textContent.includes('{name}')"):
                    browser.type("#variable", f"{name}{ENTER}")
            until("curves", lambda: browser.run("document.querySelectorAll('.curves li').length") > len(CURVES))
            check(browser, axe)
            # As somebody sees it who has looked for some seconds.
            browser.run("void (document.activeElement.blur(), scrollTo({top: 0, behavior: 'instant'}))")
            time.sleep(6)
            picture = browser.ask("GET", "/screenshot")
            file = pictures / f"page-{screen}-{scheme}.png"
            file.write_bytes(base64.b64decode(picture))
            keep(f"axe-core finds no violation on a {screen} in the {scheme} scheme")
    browser.show("phone", "light", "reduce")
    browser.open(system.looking)
    assert browser.run("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
    keep("with reduced motion the page shows its values, too")
    complaints = browser.complaints()
    assert not complaints, complaints
    keep("nothing stands in the console")


def main(condor, axe, pictures):
    with tempfile.TemporaryDirectory() as place:
        system = System(str(Path(condor).resolve()), place)
        driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, text=True)
        browser = None
        try:
            line = ""
            while "on port" not in line or not line.strip().endswith("."):
                line = driver.stdout.readline()
                assert line, "chromedriver has ended"
                if "started successfully on port" in line:
                    break
            port = int(line.rstrip().rstrip(".").split()[-1])
            browser = Browser(port)
            look(browser, system, Path(axe).read_text(), Path(pictures))
        finally:
            if browser:
                browser.ask("DELETE", "")
            driver.terminate()
            driver.wait()
            system.end()


if __name__ == "__main__":
    main(*sys.argv[1:])
