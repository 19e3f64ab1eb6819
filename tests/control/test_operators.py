"""The operators' file: names, roles, and passwords as scrypt hashes."""

import secrets
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from bench.control.operators import Hash, OperatorsFile, checked_name, may
from drivers.base.errors import ConfigurationError

GOOD = "kettle violin harbour"


@pytest.fixture(autouse=True)
def cheap_hashes(monkeypatch):
    def cheap(cls, password):
        empty = cls(salt=secrets.token_hex(16), hash="0" * 64, n=2**14, p=1)
        return empty.model_copy(update={"hash": empty.made_of(password)})

    monkeypatch.setattr(Hash, "of", classmethod(cheap))


@pytest.fixture
def operators(tmp_path):
    return OperatorsFile(tmp_path / "operators.json")


def test_the_hash_is_scrypt_as_rfc_7914_prints_it():
    printed = Hash.model_construct(salt=b"SodiumChloride".hex(), hash="", n=16384, r=8, p=1)
    assert (
        printed.made_of("pleaseletmein") == "7023bdcb3afd7348461c06cd81fd38ebfda8fbba904f8e3ea9b543f6545da1f2"
    )


def test_only_the_right_password_of_the_right_operator_fits(operators):
    operators.add("Ada  Lovelace", "run", GOOD)
    operators.add("Bob", "look", GOOD)
    assert operators.check("ada lovelace ", GOOD).signature == ("Ada Lovelace", "run")
    for name, password in (("Ada Lovelace", GOOD + " "), ("Ada Lovelace", ""), ("Eve", GOOD), ("", GOOD)):
        assert operators.check(name, password) is None
    first, second = (one.password for one in operators.all())
    assert first.hash != second.hash and first.salt != second.salt
    text = operators.path.read_text()
    assert GOOD not in text and stat.S_IMODE(operators.path.stat().st_mode) == 0o600


def test_roles_and_passwords_change_at_once_and_for_every_reader(operators):
    operators.add("Ada", "configure", GOOD)
    reader = OperatorsFile(operators.path)
    assert reader.find("ADA").role == "configure"
    operators.set_role("Ada", "answer")
    assert reader.find("Ada").role == "answer"
    operators.set_password("ada", "another one entirely")
    assert reader.check("Ada", GOOD) is None and reader.check("Ada", "another one entirely") is not None
    key = operators.key
    operators.remove("ada")
    assert reader.all() == () and reader.key == key


def test_each_role_may_what_those_before_it_may():
    roles = ("look", "answer", "run", "configure")
    assert [[may(has, needs) for needs in roles] for has in roles] == [
        [True, False, False, False],
        [True, True, False, False],
        [True, True, True, False],
        [True, True, True, True],
    ]


@pytest.mark.parametrize(
    ("name", "role", "password", "says"),
    [
        ("", "run", GOOD, "no name for the record"),
        ("a\nb\x00", "run", GOOD, "no name for the record"),
        ("<b>Ada", "run", GOOD, "no name for the record"),
        ("A" * 61, "run", GOOD, "no name for the record"),
        ("Ada", "admin", GOOD, "no such role.*look, answer, run, configure"),
        ("Ada", "run", "short", "easy to guess.*5 characters.*at least 12"),
        ("Ada", "run", "aaaaaaaaaaaaaaaa", "easy to guess"),
        ("Ada Lovelace the First", "run", "ada lovelace the first", "not the name"),
        ("Carol", "run", GOOD, "there is an operator of this name"),
    ],
)
def test_what_cannot_be_an_operator_is_refused_and_changes_nothing(operators, name, role, password, says):
    operators.add("carol", "look", GOOD)
    before = operators.path.read_bytes()
    with pytest.raises(ConfigurationError, match=f"(?s){says}"):
        operators.add(name, role, password)
    assert operators.path.read_bytes() == before


def test_a_file_that_is_none_says_so(operators):
    with pytest.raises(ConfigurationError, match=r"no such file.*operators add"):
        operators.all()
    for text in ("", "{}", '{"format": 2}', "\x00" * 40):
        operators.path.write_text(text)
        with pytest.raises(ConfigurationError, match="mistakes"):
            operators.all()
        with pytest.raises(ConfigurationError):
            operators.add("Ada", "run", GOOD)
        assert operators.path.read_text() == text
    with pytest.raises(ConfigurationError, match="no operator of this name"):
        _with_bob(operators).remove("Eve")


def _with_bob(operators):
    operators.path.unlink()
    operators.add("Bob", "look", GOOD)
    return operators


@pytest.mark.concurrent
def test_two_who_add_at_once_lose_nobody(operators):
    operators.add("first", "look", GOOD)
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda n: OperatorsFile(operators.path).add(f"number {n}", "look", GOOD), range(8)))
    assert {one.name for one in operators.all()} == {"first", *(f"number {n}" for n in range(8))}


def test_the_command_adds_lists_changes_and_removes(tmp_path):
    def gyrobench(*words, typed=""):
        command = [sys.executable, "-m", "gyrobench", "operators", *words]
        return subprocess.run(command, input=typed, capture_output=True, text=True, cwd=tmp_path, check=False)

    added = gyrobench("add", "Ada", "--role", "configure", "--stdin", typed=f"{GOOD}\n")
    assert added.returncode == 0 and "Ada may sign in (configure)" in added.stdout
    refused = gyrobench("add", "Eve", "--stdin", typed="short\n")
    assert refused.returncode == 2 and "easy to guess" in refused.stderr and "short" not in refused.stderr
    assert gyrobench("change", "ada", "--role", "look").returncode == 0
    assert '"name": "Ada", "role": "look"' in gyrobench("list", "--json").stdout
    assert gyrobench("remove", "Ada").returncode == 0
    assert '"operators": []' in gyrobench("list", "--json").stdout


def test_an_apostrophe_in_a_name_is_a_typographic_one():
    assert checked_name("  Ann  O'Brien ") == "Ann O\N{RIGHT SINGLE QUOTATION MARK}Brien"
    with pytest.raises(ConfigurationError, match="none of them <"):
        checked_name("Ann <b>")
