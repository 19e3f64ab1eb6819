"""Who asks for nothing cannot keep out who does: half requests, many connections, answers that nobody reads."""

import asyncio
from contextlib import asynccontextmanager

import pytest
import uvicorn
from uvicorn.server import ServerState

from bench.present.panel import _visitors
from bench.present.panel._access import Access
from bench.present.panel._visitors import MOST_WAITING, SERVER_LIMITS, Visitor

TOKEN = "0123456789abcdef"
ASK = f"GET / HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode()


async def page(scope, receive, send) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


@asynccontextmanager
async def panel(app=page):
    """A server of our own limits on a free port; its connections are the visitors."""
    limits = {name: value for name, value in SERVER_LIMITS.items() if name != "uvicorn_logging_level"}
    config = uvicorn.Config(Access(app, TOKEN), http=Visitor, lifespan="off", log_level="critical", **limits)
    config.load()
    state = ServerState()
    loop = asyncio.get_running_loop()
    server = await loop.create_server(lambda: Visitor(config, state, {}), "127.0.0.1", 0)
    try:
        yield server.sockets[0].getsockname()[1], state
    finally:
        server.close()
        for each in list(state.connections):
            each.transport.abort()
        await server.wait_closed()


async def until_closed(reader: asyncio.StreamReader) -> None:
    try:
        while await reader.read(65_536):
            pass
    except ConnectionError:
        pass


def test_those_who_fill_the_doorway_are_the_ones_who_are_put_out() -> None:
    async def play() -> None:
        async with panel() as (port, state):
            slow = [await asyncio.open_connection("127.0.0.1", port) for _ in range(MOST_WAITING + 40)]
            for _, writer in slow:
                writer.write(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ")
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(ASK)
            assert b" 200 " in await reader.readline()
            assert len(state.connections) <= MOST_WAITING + 1
            await until_closed(slow[0][0])  # who waited longest went first
            for _, each in [*slow, (reader, writer)]:
                each.close()

    asyncio.run(play())


@pytest.mark.parametrize(
    "sent",
    [
        b"",
        b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ",
        b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000\r\n\r\nx",
    ],
    ids=["silence", "half a head", "half a body without the token"],
)
def test_a_connection_that_asks_for_nothing_is_closed_in_time(sent, monkeypatch) -> None:
    monkeypatch.setattr(_visitors, "REQUEST_S", 0.05)

    async def play() -> None:
        async with panel() as (port, _):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(sent)
            await asyncio.wait_for(until_closed(reader), 30.0)
            writer.close()

    asyncio.run(play())


def test_answers_that_nobody_reads_hold_no_place(monkeypatch) -> None:
    """Refusals pile up until the server waits for its reader: that wait ends too."""
    monkeypatch.setattr(_visitors, "REQUEST_S", 0.3)

    async def play() -> None:
        async with panel() as (port, state):
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1)
            reader._transport.pause_reading()
            writer.write(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n" * 200_000)
            while not state.connections:
                await asyncio.sleep(0)
            while state.connections:
                await asyncio.sleep(0)
            writer.transport.abort()

    asyncio.run(play())


def test_who_was_let_in_may_take_longer(monkeypatch) -> None:
    monkeypatch.setattr(_visitors, "REQUEST_S", 0.05)

    async def long(scope, receive, send) -> None:
        loop = asyncio.get_running_loop()
        done = loop.create_future()
        loop.call_later(0.2, done.set_result, None)
        await done
        await page(scope, receive, send)

    async def play() -> None:
        async with panel(long) as (port, _):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(ASK)
            assert b" 200 " in await reader.readline()
            writer.close()

    asyncio.run(play())
