"""Telling people: each way arrives whole, none is a shell, none can hold up or fail a run."""

import http.server
import json
import socket
import sys
import threading

import pytest

from bench.campaign import Notice
from bench.campaign._notify import Announcing, Notifier
from bench.control.questions import AssumeYes, Question, Reply

pytestmark = pytest.mark.concurrent

TEXT = 'chamber at -40 °C; $(touch /tmp/never) `id` "quoted" | & > <'
KEEP = "import pathlib, sys; pathlib.Path(sys.argv[1]).write_bytes(sys.stdin.buffer.read())"


@pytest.fixture
def server():
    """A web server on this machine; `got` has what was posted, /busy is refused."""
    got = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self):
            got.append((self.path, self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(503 if self.path == "/busy" else 204)
            self.end_headers()

        def log_message(self, *args):
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as served:
        thread = threading.Thread(target=served.serve_forever, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{served.server_port}", got
        served.shutdown()
        thread.join()


def told(notices, occasion="failed", **fields):
    notifier = Notifier(tuple(notices), "Lot 12")
    notifier.tell(occasion, TEXT, **fields)
    notifier.wait()
    return list(notifier.sent)


def test_program_address_and_file_each_get_the_message(server, tmp_path):
    address, got = server
    odd = tmp_path / "a b; touch c"
    sent = told(
        [
            Notice(command=(sys.executable, "-c", KEEP, str(odd))),
            Notice(webhook=f"{address}/hook"),
            Notice(file=tmp_path / "notes.jsonl"),
        ],
        outcome="failed",
    )
    assert [row.problem for row in sent] == ["", "", ""]
    messages = [odd.read_bytes(), got[0][1], (tmp_path / "notes.jsonl").read_bytes()]
    for message in map(json.loads, messages):
        assert message["text"] == TEXT and message["campaign"] == "Lot 12" and message["outcome"] == "failed"
    assert sorted(path.name for path in tmp_path.iterdir()) == [odd.name, "notes.jsonl"]


@pytest.mark.parametrize(
    ("notice", "words"),
    [
        ({"command": ("/no/such/program",)}, "FileNotFoundError"),
        ({"command": (sys.executable, "-c", "import sys; sys.exit('no line')")}, "ended with 1: no line"),
        ({"webhook": "http://127.0.0.1:9/"}, "URLError"),
        ({"file": "/no/such/folder/notes"}, "FileNotFoundError"),
    ],
)
def test_what_does_not_arrive_is_said_and_nothing_else_happens(notice, words):
    (row,) = told([Notice(**notice)])
    assert words in row.problem


def test_a_server_that_refuses_is_a_problem(server):
    (row,) = told([Notice(webhook=f"{server[0]}/busy")])
    assert "503" in row.problem


def test_only_those_who_want_to_know_are_told(tmp_path):
    notice = Notice(on=("completed",), file=tmp_path / "notes")
    assert told([notice], "failed") == [] and len(told([notice], "completed")) == 1


def test_a_question_is_announced_and_then_asked(tmp_path):
    notifier = Notifier((Notice(file=tmp_path / "notes"),), "Lot 12")
    operator = Announcing(AssumeYes(), notifier)
    assert operator.ask(Question("Door closed?"))() == Reply("yes", "answered beforehand")
    notifier.wait()
    assert json.loads((tmp_path / "notes").read_text())["text"] == "Door closed?"


def test_what_is_no_http_is_a_problem_that_is_kept():
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def answer():
            connection, _ = listening.accept()
            connection.sendall(b"220 smtp ready\r\n")
            connection.close()

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        (sent,) = told([Notice(webhook=f"http://127.0.0.1:{listening.getsockname()[1]}/x")])
        thread.join()
    assert sent.problem
    (sent,) = told([Notice(webhook="http://lab:port/x")])
    assert "port" in sent.problem
