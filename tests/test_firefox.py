"""What trains and moves in the pages does so in Firefox, too, from disk."""

import itertools
import json
import re
import shutil
import subprocess
import time

import pytest

websocket = pytest.importorskip("websocket")
PATIENCE = 180  # seconds
LISTENING = re.compile(r"ws://\S+")
# The returns that the chart's legend names last, of transfer and of learning from nothing.
SHOWN = """["transfer", "none"].map((name) => {
  const { innerText } = document.querySelector(`.trainer .legend .${name}`);
  return Number(innerText.split(" ").pop().replace("−", "-"));
})"""


class Firefox:
    """A tab of a headless Firefox, driven by WebDriver BiDi; ``faults`` are errors of scripts."""

    def __init__(self, address):
        self._socket = websocket.create_connection(
            f"{address}/session", suppress_origin=True, timeout=PATIENCE
        )
        self._numbers, self.faults = itertools.count(), []
        self._call("session.new", capabilities={})
        self._call("session.subscribe", events=["log.entryAdded"])
        self._tab = self._call("browsingContext.getTree")["contexts"][0]["context"]

    def open(self, address):
        """Open a page and wait until it is there."""
        self._call("browsingContext.navigate", context=self._tab, url=address, wait="complete")

    def tell(self, expression):
        """What an expression of JavaScript gives, as it reads in JSON."""
        code = f"JSON.stringify({expression})"
        answer = self._call(
            "script.evaluate", expression=code, target={"context": self._tab}, awaitPromise=True
        )
        assert answer["type"] == "success", answer
        return json.loads(answer["result"].get("value", "null"))

    def wait(self, expression):
        """Wait until an expression is true."""
        last = time.monotonic() + PATIENCE
        while not self.tell(expression):
            assert time.monotonic() < last, f"never: {expression}"
            time.sleep(0.2)

    def close(self):
        """End the session."""
        self._socket.close()

    def _call(self, method, **params):
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("method") == "log.entryAdded":
                entry = message["params"]
                self.faults += [entry["text"]] * (entry["type"] == "javascript")
            elif message.get("id") == number:
                assert message["type"] == "success", message
                return message["result"]


@pytest.fixture(scope="module")
def firefox(tmp_path_factory):
    """A tab of Firefox; tests are skipped where it is not installed."""
    path = shutil.which("firefox-esr") or shutil.which("firefox")
    if path is None:
        pytest.skip("no Firefox found: apt install firefox-esr")
    profile = tmp_path_factory.mktemp("firefox")
    command = [path, "--headless", "--no-remote", "--profile", profile, "--remote-debugging-port=0"]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, env={"HOME": str(profile)}
    ) as process:
        address = next(filter(None, map(LISTENING.search, process.stderr)))
        tab = Firefox(address[0])
        yield tab
        tab.close()
        process.terminate()


@pytest.mark.parametrize("name", ["rooms_evaluation", "cartpole", "mountain_car"])
def test_each_stage_trains_to_above_no_transfer(name, book, firefox):
    firefox.open((book / "book" / f"{name}.html").as_uri())
    firefox.wait('document.querySelector(".trainer .says").innerText.startsWith("Ready")')
    firefox.tell('document.querySelector(".trainer .go").click()')
    iteration = 'Number(document.querySelector(".trainer .iteration").innerText.replace(",", ""))'
    firefox.wait(f"{iteration} >= 500 && (([ours, none]) => ours > none)({SHOWN})")
    assert firefox.tell('document.querySelector(".chart .run.transfer").getAttribute("points")')
    firefox.tell('document.querySelector(".trainer .go").click()')
    firefox.wait('document.querySelector(".trainer .says").innerText.startsWith("Paused")')
    assert not firefox.faults


def test_robots_walk_through_mazes(book, firefox):
    firefox.open((book / "book" / "mazes.html").as_uri())
    firefox.wait('document.querySelector(".walks.ready") !== null')
    place = 'Number(document.querySelector(".walks input").value)'
    picture = 'document.querySelector(".walks canvas").toDataURL()'
    firefox.wait('document.querySelector(".walks .count").innerText.includes("of 6")')
    ended = firefox.tell(picture)
    firefox.tell('document.querySelector(".walks button").click()')
    firefox.wait(f"{place} > 5 && {place} < 1000")
    assert firefox.tell(picture) != ended
    assert not firefox.faults
