"""The server of a page: what it answers, to whom, and to how many. Requests are raw bytes."""

from __future__ import annotations

import socket
import threading

import pytest
from shared import each_row

import condyn_pin as cp
from condyn_pin.viewing import viewer as server

pytestmark = pytest.mark.once

PATIENCE = 300.0  # [s] that no machine needs, for what may hang


@pytest.fixture(scope="module")
def viewer():
    with cp.view(cp.model.pendulum(), browser=False) as found:
        yield found


def port(viewer):
    return int(viewer.url.rsplit(":", 1)[1].strip("/"))


def connected(viewer):
    return socket.create_connection(("127.0.0.1", port(viewer)), timeout=PATIENCE)


def everything(connection):
    """All that a server sends until it hangs up."""
    parts = []
    while part := connection.recv(65536):
        parts.append(part)
    return b"".join(parts)


def answer(viewer, *lines):
    """The status of an answer, and what follows its headers."""
    with connected(viewer) as connection:
        connection.sendall("\r\n".join([*lines, "", ""]).encode())
        head, _, body = everything(connection).partition(b"\r\n\r\n")
    return int(head.split()[1]), body


@pytest.mark.parametrize(
    "host", ["127.0.0.1", "127.0.0.1:{port}", "localhost:{port}", "LocalHost", "[::1]:8080"]
)
def test_this_machine_is_answered(viewer, host):
    status, body = answer(viewer, "GET / HTTP/1.1", f"Host: {host.format(port=port(viewer))}")
    assert status == 200
    assert body.decode() == viewer.html


@each_row(
    "headers",
    [
        ["Host: evil.example:{port}"],
        ["Host: evil.example"],
        ["Host: 127.0.0.1.evil.example"],
        ["Host: 127.0.0.1@evil.example"],
        ["Host: localhost.evil.example:{port}"],
        ["Host: 0.0.0.0:{port}"],
        ["Host: [::1"],
        ["Host:"],
        [],
        ["Host: 127.0.0.1", "Host: evil.example"],
        ["Host: 127.0.0.1", "Origin: http://evil.example"],
        ["Host: 127.0.0.1", "Origin: null"],
    ],
)
def test_a_page_of_somebody_else_reads_nothing(viewer, headers):
    """A name of its own may be resolved to this address: DNS rebinding."""
    lines = [line.format(port=port(viewer)) for line in headers]
    status, body = answer(viewer, "GET / HTTP/1.1", *lines)
    assert status == 403
    assert b"MeshCat" not in body


@each_row(
    ("request_line", "status"),
    [
        ("GET /../etc/passwd HTTP/1.1", 404),
        ("GET http://evil.example/ HTTP/1.1", 404),
        ("GET /<script> HTTP/1.1", 404),
        ("POST / HTTP/1.1", 501),
        ("CONNECT evil.example:443 HTTP/1.1", 501),
    ],
)
def test_nothing_else_is_served(viewer, request_line, status):
    found, body = answer(viewer, request_line, "Host: 127.0.0.1")
    assert found == status
    assert b"<script>" not in body


@pytest.mark.long
def test_there_is_no_websocket(viewer):
    """The page holds everything: nobody can write to it, or listen to what is shown."""
    status, body = answer(
        viewer, "GET / HTTP/1.1", "Host: 127.0.0.1", "Connection: Upgrade", "Upgrade: websocket",
        "Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
    )  # fmt: skip
    assert status == 200
    assert body.decode() == viewer.html
    assert ".connect(" not in viewer.html.rsplit("<script>", 1)[1]


def test_connections_that_say_nothing_take_few_threads(capfd):
    with cp.view(cp.model.pendulum(), browser=False) as viewer:
        before = threading.active_count()
        silent = [connected(viewer) for _ in range(server._CONNECTIONS)]
        refused = [connected(viewer) for _ in range(3 * server._CONNECTIONS)]
        for connection in refused:  # hung up without a thread, and after all silent ones came
            assert everything(connection) == b""
            connection.close()
        assert threading.active_count() - before <= server._CONNECTIONS
        for connection in silent:
            connection.close()
        assert viewer._server._free.acquire(timeout=PATIENCE)  # a thread ends: there is room again
        viewer._server._free.release()
        status, _ = answer(viewer, "GET / HTTP/1.1", "Host: 127.0.0.1")
        assert status == 200
    assert capfd.readouterr() == ("", "")


@pytest.mark.long
def test_a_connection_that_says_nothing_is_hung_up(monkeypatch):
    monkeypatch.setattr(server._Handler, "timeout", 0.01)
    with cp.view(cp.model.pendulum(), browser=False) as viewer, connected(viewer) as connection:
        assert everything(connection) == b""


@pytest.mark.long
def test_a_reader_that_breaks_off_is_no_text_on_the_terminal(viewer, capfd):
    for _ in range(4):
        connection = connected(viewer)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")  # a reset
        connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        connection.recv(1)
        connection.close()
    assert answer(viewer, "GET / HTTP/1.1", "Host: 127.0.0.1")[0] == 200
    assert capfd.readouterr() == ("", "")
