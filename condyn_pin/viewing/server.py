"""Server: one page, for browsers of this machine only.

That it listens at 127.0.0.1 is not enough: a page of somebody else, in a browser of this machine,
may have its own name resolved to that address (DNS rebinding), and would read what is served under
it. So a request has to name this machine as its host, and as its origin if it has one. A few
connections are served at a time, none of them for long: who opens many, or says nothing on them,
takes no more of the process.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final
from urllib.parse import urlsplit

HOST: Final = "127.0.0.1"

_LOCAL: Final = (HOST, "localhost", "::1")
_CONNECTIONS: Final = 16  # at a time: a browser opens six
_PATIENCE: Final = 10.0  # [s] for the next bytes of a request, or of an answer to be taken


class Server(ThreadingHTTPServer):
    """Serves one page, to this machine only.

    Parameters
    ----------
    page : bytes
    port : int
        A free one if it is 0.
    """

    daemon_threads = True
    request_queue_size = 4 * _CONNECTIONS

    def __init__(self, page: bytes, port: int) -> None:
        self.page, self.fetched = page, threading.Event()
        self._free = threading.BoundedSemaphore(_CONNECTIONS)
        super().__init__((HOST, port), _Handler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Serve a connection in a thread of its own, or hang up if there are too many."""
        if not self._free.acquire(blocking=False):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread could be started
            self._free.release()
            raise

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve a connection, and make room for another one."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing of a connection that broke: the terminal is the user's."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = _PATIENCE

    def do_GET(self) -> None:
        """Send the page."""
        if not self._is_local():
            self.send_error(403, "Only this machine is served")
            return
        if self.path != "/":
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(self.server.page)))
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        with suppress(OSError):  # who reads no further has seen enough
            self.wfile.write(self.server.page)
            self.server.fetched.set()

    def _is_local(self) -> bool:
        """Whether a request names this machine, once, and comes from no page of another one."""
        hosts, origins = (self.headers.get_all(name, []) for name in ("Host", "Origin"))
        if len(hosts) != 1 or not _local(f"//{hosts[0]}"):
            return False
        return all(_local(origin) for origin in origins)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing."""


def _local(address: str) -> bool:
    """Whether an address is of this machine, whatever its port: it may be forwarded."""
    try:
        return urlsplit(address).hostname in _LOCAL
    except ValueError:
        return False
