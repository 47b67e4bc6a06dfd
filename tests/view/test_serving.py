"""The page's server takes orders from its own page alone, small and well formed; all else is refused in words."""

import http.client
import json
import threading
from contextlib import contextmanager

import pytest

from hotice.errors import HoticeError
from hotice.replay.serving import LiveServer, Newest, Taker

ORDER = json.dumps({"order": "restart"}).encode()


@contextmanager
def served(take, most_bytes=100):
    server = LiveServer("<p>", Newest(), taker=Taker(path="orders", most_bytes=most_bytes, take=take))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield server
    finally:
        server.newest.end()
        server.shutdown()
        server.server_close()
        thread.join()


def sent(server, body=ORDER, path="/orders", **headers):
    port = server.server_address[1]
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
    given = {"Origin": f"http://127.0.0.1:{port}", "Content-Type": "application/json"} | headers
    connection.request("POST", path, body, {name: value for name, value in given.items() if value is not None})
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_an_order_is_taken():
    taken = []
    with served(taken.append) as server:
        assert sent(server) == (200, b"{}")
        assert (
            sent(
                server,
                Origin=f"http://localhost:{server.server_address[1]}",
                Host=f"localhost:{server.server_address[1]}",
            )[0]
            == 200
        )
    assert taken == [ORDER, ORDER]


def test_a_refused_order_is_told():
    def refuse(content):
        raise HoticeError("order is 3: known are none")

    with served(refuse) as server:
        status, body = sent(server)
    assert (status, json.loads(body)) == (400, {"error": "order is 3: known are none"})


@pytest.mark.parametrize(
    ("change", "status"),
    [
        ({"Origin": "http://evil.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Origin": None}, 403),
        ({"Host": "evil.example"}, 403),
        ({"Content-Type": "text/plain"}, 415),
        ({"Content-Type": None}, 415),
        ({"path": "/other"}, 404),
        ({"body": b"x" * 101}, 413),
        ({"Content-Length": "-5"}, 413),
        ({"Content-Length": "1e3"}, 413),
        ({"Content-Length": "9" * 5000}, 413),
    ],
)
def test_what_is_not_from_the_page_is_not_taken(change, status):
    taken = []
    with served(taken.append) as server:
        assert sent(server, **change)[0] == status
    assert taken == []


def test_a_server_without_a_taker_takes_nothing():
    server = LiveServer("<p>", Newest())
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        assert sent(server)[0] == 404
    finally:
        server.shutdown()
        server.server_close()


def test_who_looks_first_is_noticed():
    with served(lambda content: None) as server:
        assert not server.looked_at.is_set()
        connection = http.client.HTTPConnection(*server.server_address[:2], timeout=20)
        connection.request("GET", "/events")
        connection.getresponse()
        assert server.looked_at.wait(10)
