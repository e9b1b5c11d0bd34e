"""A browser that is driven by its chromedriver, for the checks of the page."""

import base64
import http.client
import json
import subprocess
import time

PATIENCE_S = 60
# The greatest size of a picture: READMEs show it.
MOST_BYTES = 200_000
SCREENS = {"desktop": (1440, 1000, False), "phone": (390, 844, True)}
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

    def __init__(self):
        self.driver = subprocess.Popen(["chromedriver", "--port=0"], stdout=subprocess.PIPE, text=True)
        line = ""
        while "started successfully on port" not in line:
            line = self.driver.stdout.readline()
            assert line, "chromedriver has ended"
        self.port = int(line.rstrip().rstrip(".").split()[-1])
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

    def text(self, selector):
        return self.run(f"document.querySelector({json.dumps(selector)}).textContent")

    def value(self, selector):
        return self.run(f"document.querySelector({json.dumps(selector)}).value")

    def click(self, selector):
        # What is hidden by the header on top is in the window as the driver sees it.
        self.see(selector)
        self.ask("POST", f"/element/{self.find(selector)}/click")

    def see(self, selector):
        """Scrolls to an element."""
        self.run(f"void document.querySelector({json.dumps(selector)}).scrollIntoView({{block: 'start', behavior: 'instant'}})")

    def drag(self, start, by):
        """Moves the mouse with its button down."""
        (x, y), (right, down) = start, by
        mouse = lambda kind, part, **more: self.chrome(
            "Input.dispatchMouseEvent", type=kind, x=x + part * right, y=y + part * down, button="left", **more
        )
        mouse("mousePressed", 0, clickCount=1)
        for step in range(1, 11):
            mouse("mouseMoved", step / 10, buttons=1)
        mouse("mouseReleased", 1, clickCount=1)

    def check(self, axe):
        """Finds no violation, and nothing that is wider than the screen."""
        self.run(f"void (() => {{ {axe} }})()")
        violations = self.wait(AXE)
        told = [f"{it['id']}: {[node['target'] for node in it['nodes']]}" for it in violations]
        assert not told, told
        wide = self.run(WIDE)
        assert not wide, f"the page is too wide: {wide}"

    def photograph(self, file, clip=None):
        """Writes a picture of the screen, or of a part of the page."""
        if clip:
            picture = self.chrome("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip=clip)["data"]
        else:
            picture = self.ask("GET", "/screenshot")
        picture = base64.b64decode(picture)
        assert len(picture) <= MOST_BYTES, f"{file} has {len(picture)} bytes of at most {MOST_BYTES}"
        file.write_bytes(picture)

    def complaints(self):
        return [entry["message"] for entry in self.ask("POST", "/se/log", type="browser")]

    def end(self):
        if self.path:
            self.ask("DELETE", "")
        self.driver.terminate()
        self.driver.wait()
