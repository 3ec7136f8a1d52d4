"""The service's page in the tests' browser: what a person does with it, by mouse, keyboard and files."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.show.browser import Browser

PATIENCE = 240.0  # seconds: more is a hang on any machine, though its workers yield to all that runs beside them
READY = "document.documentElement?.dataset.ready && document.getElementById('expected')"


class Page:
    """The page of a service at `url`, open in a browser."""

    def __init__(self, browser: Browser, url: str) -> None:
        self.browser, self.url = browser, url

    def open(self, where: str = "", *, until: str = READY) -> None:
        """Load the page afresh and wait until it can be used."""
        self.browser.call("Page.navigate", url="about:blank")
        self.browser.call("Page.navigate", url=f"{self.url}/{where}")
        self.wait_for(until)

    def evaluate(self, expression: str) -> Any:
        return self.browser.evaluate(expression)

    def wait_for(self, condition: str, limit: float = PATIENCE) -> None:
        try:
            self.browser.wait_for(condition, limit)
        except TimeoutError as error:
            raise TimeoutError(f"{error}; the page says: {self.text('#run-status')!r}") from None

    def text(self, selector: str) -> str:
        """What can be read there; "" when there is no such element or it is hidden."""
        text = self.evaluate(f"document.querySelector({json.dumps(selector)})?.innerText ?? ''")
        return str(text)

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """left, top, width, height, after scrolling there."""
        script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)});
            e.scrollIntoView({{block: 'center', behavior: 'instant'}});
            const r = e.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; }})()"""
        left, top, width, height = self.evaluate(script)
        return left, top, width, height

    def mouse(self, kind: str, x: float, y: float, clicks: int = 1) -> None:
        button = {"button": "left", "buttons": 0 if kind == "mouseReleased" else 1, "clickCount": clicks}
        moving = {"button": "none", "buttons": 0}
        self.browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **(button if "Mov" not in kind else moving))

    def click(self, selector: str) -> None:
        """Click an element as a person does: once it is enabled, and again if it moved away under the mouse."""
        element = f"document.querySelector({json.dumps(selector)})"
        self.wait_for(f"!{element}.disabled")
        self.evaluate(f"window.clicked = false; {element}.addEventListener('click', () => (window.clicked = true), "
                      "{once: true, capture: true})")  # fmt: skip
        for _ in range(10):
            left, top, width, height = self.box(selector)
            self.mouse("mousePressed", left + width / 2, top + height / 2)
            self.mouse("mouseReleased", left + width / 2, top + height / 2)
            if self.evaluate("window.clicked") is not False:  # undefined: on another page
                return
        raise TimeoutError(f"{selector} cannot be clicked")

    def press(self, key: str, code: int, text: str = "") -> None:
        facts: dict[str, Any] = {"key": key, "code": key, "windowsVirtualKeyCode": code}
        typed: dict[str, Any] = {"text": text} if text else {}
        self.browser.call("Input.dispatchKeyEvent", type="keyDown", **facts, **typed)
        self.browser.call("Input.dispatchKeyEvent", type="keyUp", **facts)

    def tab(self) -> str:
        """Press the tabulator; the id of what has the focus then."""
        self.press("Tab", 9)
        return str(self.evaluate("document.activeElement.id"))

    def choose(self, selector: str, value: str, *, stays: bool = True) -> None:
        """Set a control as a person does, a list once it has that choice. stays: it then shows that value."""
        options = f"document.querySelector({json.dumps(selector)}).options"
        self.wait_for(f"document.querySelector({json.dumps(selector)})")  # forms come with what describes them
        self.wait_for(f"!{options} || [...{options}].some(x => x.value === {json.dumps(value)})")
        script = f"""(() => {{ const e = document.querySelector({json.dumps(selector)}); e.value = {json.dumps(value)};
            e.dispatchEvent(new Event('input', {{bubbles: true}}));
            e.dispatchEvent(new Event('change', {{bubbles: true}})); return e.value; }})()"""
        assert self.evaluate(script) == value or not stays

    def upload(self, path: Path, identifier: str = "file") -> None:
        """Give a file input a file, as its dialog does."""
        element = self.browser.call("Runtime.evaluate", expression=f"document.getElementById('{identifier}')")
        self.browser.call("DOM.setFileInputFiles", files=[str(path)], objectId=element["result"]["objectId"])

    def drop(self, name: str, content: str) -> None:
        """Drop a file on the window."""
        self.evaluate(f"""(() => {{ const data = new DataTransfer();
            data.items.add(new File([{json.dumps(content)}], {json.dumps(name)}));
            for (const kind of ['dragenter', 'dragover', 'drop'])
              window.dispatchEvent(new DragEvent(kind, {{dataTransfer: data, cancelable: true}})); }})()""")

    def drop_path(self, path: Path) -> None:
        """Drop a file or a folder of the disk on the window, as a file manager does."""
        data = {"items": [], "files": [str(path)], "dragOperationsMask": 1}
        for kind in ("dragEnter", "dragOver", "drop"):
            self.browser.call("Input.dispatchDragEvent", type=kind, x=300, y=300, data=data)

    def run(self) -> None:
        """Press Run and wait for the curves with their error bar."""
        self.click("#run-button")
        done = "!document.getElementById('run-button').disabled"
        self.wait_for(f"{done} && ['result', 'playback', 'downloads'].every(id => !document.getElementById(id).hidden)")

    def colours(self, canvases: str = "#plots canvas", place: int = 0) -> int:
        """How many different pixels one of the canvases has: 1 is a blank one."""
        counted = self.evaluate(f"""(() => {{ const canvas = document.querySelectorAll({json.dumps(canvases)})[{place}];
            const data = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data;
            return new Set(new Uint32Array(data.buffer)).size; }})()""")
        return int(counted)

    def robot(self) -> np.ndarray:
        """The picture of the robot, (height, width, 3)."""
        left, top, width, height = (round(x) for x in self.box("#pane"))
        return self.browser.screenshot()[max(top, 0) : top + height, left : left + width]

    def moves(self, before: np.ndarray | None = None, seconds: float = PATIENCE) -> bool:
        """Whether the picture of the robot changes from what it was before, or is now, within some seconds."""
        first = self.robot() if before is None else before
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            if (self.robot() != first).any(axis=-1).sum() > 200:
                return True
        return False

    def outside(self) -> list[str]:
        """What was asked of others than the service."""
        allowed = (f"{self.url}/", f"ws{self.url[4:]}/", f"blob:{self.url}/", "data:", "about:")
        return [url for url in self.browser.requests if not url.startswith(allowed)]

    def faults(self) -> list[str]:
        """JavaScript errors; not the refusals of the service, which browsers put down as errors too."""
        return [error for error in self.browser.errors if '"source": "network"' not in error]
