"""Signing in at the panel: who is let in, to what, for how long, and what the record says of them."""

import asyncio
import json
import re
import secrets
from pathlib import Path
from types import SimpleNamespace

import itsdangerous.timed
import pytest

from bench.control.operators import Hash, OperatorsFile
from bench.control.run_record import decode_run
from bench.present.panel import PanelSettings, _sign_in
from bench.present.panel._access import COOKIE, Access, needed, visit_of
from bench.present.panel._presence import Presence
from bench.present.panel._sign_in import Doorkeeper, Sessions, TooMany
from bench.present.panel._sign_in_routes import _inside
from bench.record.recording import read_manifest, verify
from drivers.base.errors import ConfigurationError
from tests.present.panel.browser import NEEDED, browser_page
from tests.present.panel.test_panel_queue import bench_with_panel

ADA, BOB, CYD, ROOT = (
    "kettle violin harbour",
    "maple stairs comet",
    "window river seven",
    "granite lemon tide",
)
TOKEN = "0123456789abcdef-good"


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch):
    def cheap(cls, password):
        empty = cls(salt=secrets.token_hex(16), hash="0" * 64, n=2**14, p=1)
        return empty.model_copy(update={"hash": empty.made_of(password)})

    monkeypatch.setattr(Hash, "of", classmethod(cheap))


@pytest.fixture
def operators(tmp_path: Path) -> OperatorsFile:
    file = OperatorsFile(tmp_path / "operators.json")
    for name, role, password in (
        ("Ada", "run", ADA), ("Bob", "look", BOB), ("Cyd", "answer", CYD), ("Root", "configure", ROOT),
    ):  # fmt: skip
        file.add(name, role, password)
    return file


@pytest.fixture
def sessions(operators: OperatorsFile) -> Sessions:
    return Sessions(operators)


class Door:
    """The panel's door with somebody who asks at it."""

    def __init__(self, sessions: Sessions | None, token: str | None = TOKEN) -> None:
        self.access = Access(self._inner, token, sessions)
        self.visit = None

    async def _inner(self, scope, receive, send) -> None:
        self.visit = visit_of(SimpleNamespace(scope=scope)) if scope["state"] else None
        await send({"type": "through", "status": 200})

    def ask(self, path: str = "/", method: str = "GET", kind: str = "http", **headers: str):
        """Return the status (200: let in) and the headers of the answer."""
        fields = {"host": "bench:8765", "accept": "text/html", **headers}
        raw = [(name.encode(), text.encode("latin-1")) for name, text in fields.items()]
        scope = {"type": kind, "path": path, "method": method, "headers": raw, "query_string": b"a=1"}
        scope |= {"scheme": "http", "state": {}}
        sent = []

        async def send(message) -> None:
            sent.append(message)

        async def receive():
            return {}

        asyncio.run(self.access(scope, receive, send))
        found = {name.decode(): text.decode() for name, text in sent[0].get("headers", [])}
        return sent[0].get("status", sent[0].get("code", 0)), found


def cookie(sessions: Sessions, name: str) -> dict[str, str]:
    return {"cookie": f"{COOKIE}={sessions.begin(sessions.operators.find(name))}"}


def test_a_stranger_sees_the_door_and_nothing_else(sessions: Sessions) -> None:
    door = Door(sessions)
    status, headers = door.ask("/history")
    assert (status, headers["location"]) == (303, "/sign-in?to=%2Fhistory%3Fa%3D1")
    assert door.ask("/panel/queue/x", accept="application/json")[0] == 401
    assert door.ask("/", "POST")[0] == 401 and door.ask(kind="websocket")[0] == 4401
    for path in ("/sign-in", "/panel/style.css", "/panel/assets/icon.svg"):
        assert door.ask(path)[0] == 200
    for wrong in ("", "x", "a.b.c", TOKEN, "WyJBZGEiXQ.aaaaaa." + "b" * 27):
        assert door.ask(cookie=f"{COOKIE}={wrong}")[0] == 303
    assert door.ask("/sign-in", "POST", origin="https://evil.example")[0] == 403


def test_each_role_reaches_what_it_may(sessions: Sessions) -> None:
    door = Door(sessions)
    doing = [
        ("GET", "/"), ("GET", "/history"), ("GET", "/report/x"), ("GET", "/metrics"),
        ("POST", "/panel/queue/b/plan"),
        ("POST", "/sign-out"), ("POST", "/panel/acknowledge"), ("POST", "/anything-new"),
        ("POST", "/panel/queue/b/change"), ("POST", "/panel/queue/b/rehearse"), ("POST", "/panel/recover/r"),
        ("GET", "/operators"), ("POST", "/operators"),
    ]  # fmt: skip
    reached = {
        name: sum(door.ask(path, method, **cookie(sessions, name))[0] == 200 for method, path in doing)
        for name in ("Bob", "Cyd", "Ada", "Root")
    }
    assert reached == {"Bob": 6, "Cyd": 8, "Ada": 11, "Root": 13}
    assert {needed(method, path) for method, path in doing[:6]} == {"look"}


def test_a_script_with_the_token_looks_and_does_nothing(sessions: Sessions) -> None:
    door = Door(sessions)
    bearer = {"authorization": f"Bearer {TOKEN}"}
    assert door.ask("/metrics", **bearer)[0] == 200 and door.visit.role == "look"
    assert door.ask("/panel/queue/b/change", "POST", **bearer)[0] == 403
    assert Door(sessions, None).ask("/metrics", authorization="Bearer ")[0] == 303


def test_a_session_ends_with_its_time_its_operator_its_password_and_its_sign_out(
    sessions: Sessions, operators: OperatorsFile, monkeypatch
) -> None:
    token = sessions.begin(operators.find("Ada"))
    assert Sessions(OperatorsFile(operators.path)).of(token).name == "Ada"  # a panel that was started anew
    presence = Presence(SimpleNamespace(name="Ada", role="run", token=token), sessions)
    assert presence.may("run") and not presence.may("configure")
    operators.set_role("Ada", "look")
    assert sessions.of(token).role == "look" and not presence.may("run")
    now = itsdangerous.timed.time.time()
    late = now + _sign_in.SESSION_S + 5
    with monkeypatch.context() as later:
        later.setattr(itsdangerous.timed.time, "time", lambda: late)
        assert sessions.of(token) is None
    assert sessions.of(token) is not None
    other = sessions.begin(operators.find("Bob"))
    sessions.end(other)
    assert sessions.of(other) is None
    operators.set_password("Ada", ROOT + "x")
    assert sessions.of(token) is None and not presence.may("look")
    token = sessions.begin(operators.find("Ada"))
    operators.remove("Ada")
    operators.add("Ada", "configure", ADA)
    assert sessions.of(token) is None  # of the same name, somebody else
    assert all(password not in token for password in (ADA, operators.find("Ada").password.hash))


def test_who_guesses_waits_and_keeps_nobody_else_out(operators: OperatorsFile, monkeypatch) -> None:
    time = [100.0]
    monkeypatch.setattr(_sign_in, "host_seconds", lambda: time[0])
    door = Doorkeeper(operators)

    def enter(name: str, password: str, address: str = "10.0.0.7"):
        found = asyncio.run(door.check(name, password, address))
        return None if found is None else found.name

    for _ in range(5):
        assert enter("Ada", "guess") is None
    with pytest.raises(TooMany) as waits:
        enter("ada ", ADA)
    assert waits.value.wait_s == pytest.approx(15.0)
    assert enter("Ada", ADA, "10.0.0.8") == "Ada" and enter("Bob", BOB) == "Bob"
    time[0] += 15.1
    assert enter("Ada", "guess again") is None
    with pytest.raises(TooMany) as waits:
        enter("Ada", ADA)
    assert waits.value.wait_s == pytest.approx(30.0)
    time[0] += 30.1
    assert enter("Ada", ADA) == "Ada" and enter("Ada", "wrong once") is None and enter("Ada", ADA) == "Ada"


def test_one_password_is_looked_at_at_a_time_and_not_too_many_wait() -> None:
    going = most = 0

    def slow(name: str, password: str) -> None:
        nonlocal going, most
        going += 1
        most = max(most, going)
        going -= 1

    async def play():
        door = Doorkeeper(SimpleNamespace(check=slow))
        many = (door.check(f"n{number}", "x", "a") for number in range(20))
        return await asyncio.gather(*many, return_exceptions=True)

    found = asyncio.run(play())
    assert most == 1 and sum(isinstance(one, TooMany) for one in found) == 12


def test_signing_in_leads_nowhere_else() -> None:
    for address in ("/", "/history?unit=A", "/?session=a%20b"):
        assert _inside(address) == address
    for address in (
        "//evil.example",
        "https://evil.example",
        "/\\evil.example",
        "evil",
        "",
        "/\nx",
        "http://[",
    ):
        assert _inside(address) == "/"


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"operators": "none.json"}, "no such file"),
        ({"operators": "operators.json", "host": "0.0.0.0"}, "everybody to read.*tls-elsewhere"),
        ({"operators": "empty.json"}, "nobody may sign in"),
        ({"certificate": "none.pem"}, "certificate cannot be used"),
        ({"certificate": "operators.json"}, "certificate cannot be used"),
        ({"key": "none.pem"}, "key without its certificate"),
    ],
)
def test_what_cannot_be_signed_in_at_is_refused(operators, tmp_path: Path, settings: dict, says: str) -> None:
    (tmp_path / "empty.json").write_text(json.dumps({"format": 1, "key": "0" * 64, "operators": []}))
    paths = {name: tmp_path / text if name != "host" else text for name, text in settings.items()}
    with pytest.raises(ConfigurationError, match=f"(?s){says}"):
        PanelSettings(tmp_path, port=0, **paths).check()


def certificate_files(folder: Path) -> tuple[Path, Path]:
    """Return a certificate of its own signing for 127.0.0.1, and its key."""
    import datetime as dt
    from ipaddress import ip_address

    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec

    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "bench")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder(name, name, key.public_key(), x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.IPAddress(ip_address("127.0.0.1"))]), critical=False)
        .sign(key, hashes.SHA256())
    )
    pem, key_pem = folder / "bench.pem", folder / "bench.key"
    pem.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    plain = serialization.NoEncryption()
    key_pem.write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain)
    )
    return pem, key_pem


def sign_in(page, url: str, name: str, password: str) -> None:
    page.goto(url)
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(password)
    page.get_by_test_id("sign-in").click()


@pytest.mark.concurrent
@pytest.mark.parametrize("mark", [pytest.param(None, marks=NEEDED)])
def test_three_operators_over_tls_and_what_the_record_says_of_them(
    tmp_path: Path, operators, monkeypatch, mark
) -> None:
    """Ada starts and answers, Bob may only look, Cyd aborts; all signed, and the run verifies."""
    from playwright.sync_api import expect

    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    pem, key = certificate_files(tmp_path)
    options = ("--operators", operators.path, "--certificate", pem, "--key", key)
    with bench_with_panel(tmp_path, *options, max_rate_dps=15, min_temp_c=-50) as bench:
        assert bench.panel.url.startswith("https")
        with browser_page(390) as page:
            sign_in(page, bench.form("constant-rotation"), "ada", "not it, not at all")
            expect(page.get_by_role("alert")).to_contain_text("do not fit together")
            page.get_by_label("Password").fill(ADA)
            page.get_by_test_id("sign-in").click()
            page.locator("#p-turns").fill("10000")
            expect(page.get_by_test_id("name")).to_have_value("Ada")
            expect(page.locator("[data-plan-body]")).to_contain_text("about ")
            page.get_by_test_id("start-now").click()
            page.get_by_test_id("start-yes").click()
            page.get_by_role("link", name="Watch it").click()
            page.get_by_test_id("answer-yes").click()
            expect(page.get_by_test_id("state")).to_have_text("Running")
            page.get_by_role("button", name="sign out").click()
            expect(page.get_by_test_id("sign-in")).to_be_visible()

            sign_in(page, bench.panel.url, "Bob", BOB)
            expect(page.get_by_test_id("state")).to_have_text("Running")
            expect(page.get_by_test_id("abort")).to_be_disabled()
            page.goto(bench.address)
            expect(page.locator("main, .hint").first).to_contain_text("You are signed in to look")
            page.get_by_test_id("hold").click()
            expect(page.locator("[data-said]")).to_contain_text("needs the role run")
            page.goto(bench.panel.url + "operators")
            expect(page.locator("body")).to_contain_text("needs the role configure")
            page.goto(bench.address)
            page.get_by_role("button", name="Sign out").click()
            expect(page.get_by_test_id("sign-in")).to_be_visible()

            sign_in(page, bench.panel.url, "Cyd", CYD)
            page.wait_for_function("window.gyrobench?.messages > 0")
            page.get_by_test_id("abort").click()
            page.get_by_test_id("abort-now").click()
            expect(page.get_by_test_id("state")).to_have_text("Aborted")

            # whoever may configure lets somebody in; who is taken out is out at once
            page.get_by_role("button", name="sign out").click()
            expect(page.get_by_test_id("sign-in")).to_be_visible()
            sign_in(page, bench.panel.url + "operators", "Root", ROOT)
            page.get_by_label("Name, as it stands").fill("Dee")
            page.get_by_label("First password").fill("a long enough one")
            page.get_by_test_id("add-operator").click()
            expect(page.get_by_role("status")).to_have_text("Dee may sign in (run).")
            page.get_by_role("button", name="Remove Ada").click()
            expect(page.get_by_role("status")).to_contain_text("Ada cannot sign in any more")
            page.goto(bench.panel.url)
            page.wait_for_function("window.gyrobench?.messages > 0")
            operators.remove("Root")
            expect(page.get_by_test_id("sign-in")).to_be_visible()

        (run,) = (path.parent for path in bench.panel.runs.glob("*/manifest.json"))
        events = [json.loads(line) for line in (run / "events.jsonl").read_text().splitlines()]
        signed = [
            (row["kind"], row["by"], row["role"])
            for row in events
            if row["kind"] in ("started", "answer", "request")
        ]
        assert signed == [("started", "Ada", "run"), ("answer", "Ada", "run"), ("request", "Cyd", "answer")]
        manifest = read_manifest(run)
        assert [(one.name, one.role, one.did) for one in manifest.operators] == [
            ("Ada", "run", ("started", "answered")),
            ("Cyd", "answer", ("aborted",)),
        ]
        assert verify(run, decode_run).passed
        text = (run / "manifest.json").read_text()
        (run / "manifest.json").write_text(re.sub('"name": "Ada"', '"name": "Eve"', text))
        said = [problem.text for problem in verify(run, decode_run).problems]
        assert "who did what is not that of the events" in said
