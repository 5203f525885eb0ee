"""A page that is served in a thread of the tests, and requests to it as any program could send them."""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tornado.httpclient import HTTPRequest
from tornado.websocket import websocket_connect

from wakeflow.extras.page.server import Page


@dataclass
class Served:
    """A page under test."""

    page: Page

    @property
    def address(self) -> str:
        return self.page.address

    def request(
        self, path: str, method: str = "GET", body: str | None = None, headers: Mapping[str, str] | None = None
    ) -> tuple[int, str, Mapping[str, str]]:
        """Status, text and headers of one request to a raw ``path``, sent as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.page.port, timeout=60)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            return answer.status, answer.read().decode(), dict(answer.getheaders())
        finally:
            connection.close()

    def ask(self, action: str, **what: Any) -> Any:
        """The answer of an action as the page's own script gets it; of a mistake its words."""
        headers = {"Content-Type": "application/json", "Origin": f"http://127.0.0.1:{self.page.port}"}
        status, text, _ = self.request(f"/{self.page.token}/{action}", "POST", json.dumps(what), headers)
        assert status == 200, (status, text)
        return json.loads(text)

    @contextmanager
    def listening(self, token: str = "", headers: Mapping[str, str] | None = None) -> Iterator[Callable[[], Any]]:
        """What hears of a page's news as its script does: each call gives the next."""
        own = {"Origin": f"http://127.0.0.1:{self.page.port}"}
        address = f"ws://127.0.0.1:{self.page.port}/{token or self.page.token}/events"

        async def opened() -> Any:
            return await websocket_connect(HTTPRequest(address, headers=dict(headers or own)))

        async def read() -> Any:
            return await connection.read_message()

        def done(task: Any) -> Any:
            return asyncio.run_coroutine_threadsafe(task, self.page.loop).result(60)

        connection = done(opened())
        yield lambda: json.loads(done(read()))
        self.page.loop.call_soon_threadsafe(connection.close)


@contextmanager
def served(what: Path | None, runs: Path) -> Iterator[Served]:
    """Serve ``what``; runs go below the folder ``runs``."""
    begun, found = threading.Event(), list[Page]()

    async def main() -> None:
        page = Page(what, runs=runs)
        page.listen([0])
        found.append(page)
        begun.set()
        await page.serve()

    thread = threading.Thread(target=lambda: asyncio.run(main()), name="page")
    thread.start()
    assert begun.wait(60)
    try:
        yield Served(found[0])
    finally:
        if thread.is_alive():
            found[0].loop.call_soon_threadsafe(found[0].ended.set)
        thread.join(60)
        assert not thread.is_alive()
