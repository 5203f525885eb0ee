"""The server behind the page: on this machine alone, for whoever knows the token, and only for its own page.

Nothing is loaded from outside and nothing is sent there. A request must name this machine as its host (another name
that leads here is a rebound name server), carry the token in its path, and, where it changes anything, come from the
page itself (its Origin) as JSON, which no form of another site can send. Reports are shown without any right to the
page around them.
"""

from __future__ import annotations

import asyncio
import hmac
import json
import mimetypes
import secrets
import signal
import sys
import webbrowser
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from ...core.code_key import PACKAGE
from ...core.errors import SceneError, WakeflowError
from .session import RUNS, Session

HERE = Path(__file__).parent
STYLE = PACKAGE / "show" / "html" / "style.css"  # colours and tables are the report's
FILES = {"": HERE / "page.html", "style.css": STYLE}
FILES |= {name: HERE / name for name in ("page.css", "core.js", "page.js", "machine.js", "results.js", "search.js")}
ADDRESS = "127.0.0.1"
PORTS = range(8765, 8815)  # that are tried
LARGEST = 4_000_000  # bytes of a request
QUIET = 4.0  # s without a page, a run or a request after which the server ends
WATCH = 1.0  # s between looks at the scene file
ALIVE = 10.0  # s between signs of life to a page
OWN = "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; frame-src 'self'; " \
      "frame-ancestors 'none'; form-action 'none'; base-uri 'none'"  # fmt: skip
REPORT = "sandbox allow-scripts; default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; " \
         "script-src 'unsafe-inline'; frame-ancestors 'self'"  # fmt: skip
REPORTS = {"run": "report.html", "compared": "compare.html", "protocol": "protocol.html"}
SLOW = ("plan", "inside", "before", "compare")  # actions that no other waits for


class Page:
    """A session that is served: its open pages hear what changes; it ends when none is left and nothing is computed."""

    def __init__(self, what: Path | None, *, runs: Path = RUNS) -> None:
        self.token, self.once = secrets.token_urlsafe(24), secrets.token_urlsafe(24)
        self.loop = asyncio.get_running_loop()
        self.ended = asyncio.Event()
        self.pages: set[_News] = set()
        self.seen = False  # whether any page was ever open
        self.working, self.heard = 0, False  # requests that are worked on; whether one was since the last look
        self.port = 0
        self._quick, self._slow = (ThreadPoolExecutor(1, thread_name_prefix=name) for name in ("quick", "slow"))
        self.session = Session(what, self.say, runs)

    @property
    def address(self) -> str:
        """Where the page is, with its token."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    @property
    def first_address(self) -> str:
        """What leads to the page once: a browser's command line, with the address in it, is seen by all users."""
        return f"http://{ADDRESS}:{self.port}/once/{self.once}"

    def listen(self, ports: Sequence[int]) -> None:
        """Take the first of ``ports`` that is free, 0 any. Raises SceneError where there is none."""
        routes = {
            r"/once/(.*)": _FirstVisit, r"/([^/]*)/(events)": _News, r"/([^/]*)/(.*)": _Handler, r".*": _NotFound,
        }  # fmt: skip
        application = Application(
            [(path, kind, {"page": self}) for path, kind in routes.items()], log_function=_log,
            websocket_ping_interval=ALIVE,
        )  # fmt: skip
        for port in ports:
            try:
                sockets = bind_sockets(port, ADDRESS)
            except OSError:
                continue
            self._server = HTTPServer(application, max_body_size=LARGEST)
            self._server.add_sockets(sockets)
            self.port = sockets[0].getsockname()[1]
            return
        raise SceneError(f"port {ports[0]} is taken; choose another: --port 0 takes any that is free")

    def say(self, kind: str, data: dict[str, object]) -> None:
        """Tell every open page; from any thread."""
        text = json.dumps({"kind": kind, "data": data}, allow_nan=False, default=str)
        self.loop.call_soon_threadsafe(self._tell, text)

    def _tell(self, text: str) -> None:
        for page in list(self.pages):
            page.tell(text)

    async def act(self, name: str, ask: dict[str, Any]) -> dict[str, object]:
        """Do one action of the session in a thread of its kind."""
        if name not in self.session.actions:
            raise HTTPError(404)
        pool = self._slow if name in SLOW else self._quick
        self.working += 1
        try:
            return await self.loop.run_in_executor(pool, partial(self.session.actions[name], **ask))
        finally:
            self.working, self.heard = self.working - 1, True

    async def serve(self) -> None:
        """Serve until the last page is closed and nothing is computed, or the process is asked to end."""
        quiet = 0.0
        while not self.ended.is_set():
            await self.loop.run_in_executor(self._quick, self.session.watch)
            busy = self.pages or self.working or self.heard or self.session.queue.busy
            quiet, self.heard = (quiet + WATCH if self.seen and not busy else 0.0), False
            if quiet > QUIET:
                break
            await _sleep(self.ended, WATCH)
        self._tell('{"kind": "end", "data": {}}')
        self._server.stop()
        await asyncio.sleep(0.05)  # for the pages to hear it
        self.ended.set()
        await self._server.close_all_connections()
        await self.loop.run_in_executor(self._quick, self.session.close)
        for pool in (self._quick, self._slow):
            pool.shutdown()


def _log(handler: RequestHandler) -> None:
    """Log only what fails here, which is worth a line where ``wakeflow open`` was started."""
    if handler.get_status() >= 500:
        sys.stderr.write(f"wakeflow: {handler.request.method} {handler.request.path.rpartition('/')[2]} failed\n")


async def _sleep(ended: asyncio.Event, seconds: float) -> None:
    try:
        await asyncio.wait_for(ended.wait(), seconds)
    except TimeoutError:
        return


class _Guarded(RequestHandler):
    """What every answer has in common."""

    def initialize(self, page: Page) -> None:
        self.page = page

    def set_default_headers(self) -> None:
        self.clear_header("Server")
        for name, value in {
            "Content-Security-Policy": OWN, "Referrer-Policy": "no-referrer", "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store", "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
        }.items():  # fmt: skip
            self.set_header(name, value)

    def check_host(self) -> str:
        """The host that is asked for, this machine. Raises HTTPError for another."""
        host: str = self.request.headers.get("Host", "")
        if host not in (f"{ADDRESS}:{self.page.port}", f"localhost:{self.page.port}"):
            raise HTTPError(403)
        return host

    def write_error(self, status_code: int, **_: Any) -> None:
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        words = {403: "Open the address that wakeflow open has printed.\n", 404: "There is nothing here.\n"}
        self.finish(words.get(status_code, f"{status_code}\n"))

    def log_exception(self, kind: Any, value: Any, trace: Any) -> None:
        if not isinstance(value, HTTPError):
            super().log_exception(kind, value, trace)


class _NotFound(_Guarded):
    """Refuses whatever has no token in its path."""

    def prepare(self) -> None:
        raise HTTPError(403)


class _FirstVisit(_Guarded):
    """The way of the browser that is started to the page."""

    def get(self, code: str) -> None:
        self.check_host()
        if not self.page.once or not hmac.compare_digest(code.encode(), self.page.once.encode()):
            raise HTTPError(403)
        self.page.once = ""
        self.redirect(f"/{self.page.token}/")


class _Known(_Guarded):
    """What only the page itself may ask for: its token is in the path."""

    def prepare(self) -> None:
        host = self.check_host()
        if not hmac.compare_digest(self.path_args[0].encode(), self.page.token.encode()):
            raise HTTPError(403)
        if self.request.method not in ("GET", "POST"):
            raise HTTPError(405)
        if self.request.headers.get("Origin", f"http://{host}") != f"http://{host}":
            raise HTTPError(403)
        if self.request.headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin"):
            raise HTTPError(403)


class _News(_Known, WebSocketHandler):
    """What changes, as it does, for as long as the page is open. Of ordinary connections, as of a stream of events, a
    browser opens six to a host and no more: the seventh page would wait for ever.
    """

    def check_origin(self, origin: str) -> bool:
        """Whether a page of this address asks; :meth:`prepare` has refused every other."""
        return origin == f"http://{self.check_host()}"

    def open(self, *_: str) -> None:
        self.page.pages.add(self)
        self.page.seen = True

    def tell(self, text: str) -> None:
        """Tell the page, if it is still there."""
        with suppress(WebSocketClosedError):
            self.write_message(text).add_done_callback(lambda sent: sent.cancelled() or sent.exception())

    def on_message(self, message: str | bytes) -> None:
        """A page only listens here."""

    def on_close(self) -> None:
        self.page.pages.discard(self)


class _Handler(_Known):
    """The page, its files and what it asks for."""

    def prepare(self) -> None:
        super().prepare()
        kind = self.request.headers.get("Content-Type", "").partition(";")[0]
        if self.request.method == "POST" and kind != "application/json":
            raise HTTPError(403)

    def get(self, _: str, path: str) -> None:
        first, _, rest = path.partition("/")
        finished = self.page.session.finished
        try:
            if path in FILES:
                file = FILES[path]
            elif first in REPORTS and rest:
                file = finished.file(rest.removesuffix("/"), REPORTS[first])
                self.set_header("Content-Security-Policy", REPORT)
            elif first == "figure" and rest:
                file = finished.figure(rest)
            else:
                raise HTTPError(404)
        except SceneError:
            raise HTTPError(404) from None
        self.set_header("Content-Type", f"{mimetypes.guess_type(file.name or 'page.html')[0]}; charset=utf-8")
        self.finish(file.read_bytes())

    async def post(self, _: str, name: str) -> None:
        try:
            ask = json.loads(self.request.body)
            if not isinstance(ask, dict):
                raise ValueError(ask)
        except (ValueError, RecursionError):
            raise HTTPError(400) from None
        try:
            answer = await self.page.act(name, ask)
        except ValidationError as problem:
            first = problem.errors()[0]
            answer = {"refused": f"{name}: {'.'.join(map(str, first['loc']))}: {first['msg']}"}
        except WakeflowError as problem:
            answer = {"refused": str(problem)}
        except OSError as problem:  # a full disk, a folder without the right to write
            answer = {"refused": f"{problem.filename or name}: {problem.strerror}"}
        self.finish(json.dumps(answer, allow_nan=False, default=str))


def open_page(
    what: Path | None, *, ports: Sequence[int] = PORTS, browser: bool = True,
    ready: Callable[[str], object] = print,
) -> None:  # fmt: skip
    """Serve the page of a scene, a run or a folder until its last page is closed or the process is interrupted.

    ``ready`` hears the address. Raises SceneError where ``what`` is nothing.
    """
    asyncio.run(_serve(what, ports, browser, ready))


async def _serve(what: Path | None, ports: Sequence[int], browser: bool, ready: Callable[[str], object]) -> None:
    page = Page(what)
    try:
        page.listen(ports)
    except SceneError:
        page.session.close()
        raise
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        page.loop.add_signal_handler(number, page.ended.set)
    ready(page.address)
    if browser:
        await page.loop.run_in_executor(None, webbrowser.open, page.first_address)
    await page.serve()
