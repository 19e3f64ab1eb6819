"""Signatures: minisign's own example, whatever is changed is found, and what a run's signature is worth."""

import base64
import json
import shutil
import stat
from pathlib import Path

import pytest

from bench.control.recover import recover
from bench.control.run_record import RunRecord, decode_run
from bench.record.benchfile import bench_file_from
from bench.record.recording import read_manifest, seal, verify
from bench.record.signing import NotSigned, PublicKey, SigningKey, bench_key, check_file, key_file, sign_file
from drivers.base.errors import ConfigurationError

# An example of minisign's format that circulates with its Rust implementation, minisign-verify: the file "test".
EXAMPLE_KEY = "RWQf6LRCGA9i53mlYecO4IzT51TGPpvWucNSCh1CBM0QTaLn73Y7GFO3"
EXAMPLE = """untrusted comment: signature from minisign secret key
RUQf6LRCGA9i559r3g7V1qNyJDApGip8MfqcadIgT9CuhV3EMhHoN1mGTkUidF/z7SrlQgXdy8ofjb7bNJJylDOocrCo8KLzZwo=
trusted comment: timestamp:1633700835\tfile:test\tprehashed
wLMDjy9FLAuxZ3q4NlEvkgtyhrr0gtTu6KC4KBJdITbbOeAi1zBIYo0v4iTgt8jJpIidRJnp94ABQkJAgAooBQ==
"""
FILE = {
    "bench": {"name": "signed", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/nowhere/table"},
    "chamber": {"driver": "weiss", "port": "/nowhere/chamber"},
    "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F", "axis": "x", "port": "/nowhere/fog"}],
}


@pytest.fixture
def key(tmp_path, monkeypatch):
    monkeypatch.setenv("GYROBENCH_KEY", str(tmp_path / "bench.key"))
    made = SigningKey.new("Bench 3, Laboratory")
    made.save(key_file())
    return made


def sealed(runs, name="run"):
    record = RunRecord.create(runs, name, "test", {}, bench_file_from(FILE), None)
    for port in ("fog_1", "table", "chamber"):
        record.tap(port).received(b"abc", 0.5)
    record.stream_starts("fog_1", 0)
    record.close("completed", "", 1.0)
    return runs / name


def problems(folder, *keys, must=False):
    report = verify(folder, decode_run, keys, must_be_signed=must)
    return {problem.path: problem.text for problem in report.problems}


def test_an_example_of_minisigns_own_format_is_checked():
    known = PublicKey.from_text(f"untrusted comment: minisign public key\n{EXAMPLE_KEY}\n")
    assert known.line == EXAMPLE_KEY
    assert known.check(b"test", EXAMPLE) == "timestamp:1633700835\tfile:test\tprehashed"
    for content, signature in (
        (b"Test", EXAMPLE),
        (b"test", EXAMPLE.replace("1633700835", "1633700836")),
        (b"test", EXAMPLE.replace("i559r3g7V", "i559r3g7W")),
    ):
        with pytest.raises(NotSigned, match="not of these bytes"):
            known.check(content, signature)
    with pytest.raises(NotSigned, match="damaged"):
        known.check(b"test", EXAMPLE[:-40])


def test_what_a_new_key_signs_has_minisigns_form_and_every_changed_byte_is_found(tmp_path, key):
    path = tmp_path / "certificate.html"
    path.write_bytes(b"passed")
    signature = sign_file(path, key).read_text()
    lines = signature.splitlines()
    data = base64.b64decode(lines[1])
    assert (data[:2], len(data), data[2:10]) == (b"ED", 74, base64.b64decode(key.public.line)[2:10])
    assert lines[2].startswith("trusted comment: file:certificate.html\tsigned:")
    assert check_file(path, [key.public])[0] == key.public
    for at in range(6):
        changed = bytearray(b"passed")
        changed[at] ^= 1
        path.write_bytes(changed)
        with pytest.raises(NotSigned):
            check_file(path, [key.public])


def test_the_secret_key_is_its_owners_alone_and_is_never_written_over(key):
    assert stat.S_IMODE(key_file().stat().st_mode) == 0o600
    assert bench_key().public == key.public
    assert Path(f"{key_file()}.pub").read_text() == key.public.text
    with pytest.raises(ConfigurationError, match="there is a key already"):
        SigningKey.new("another").save(key_file())


def test_a_sealed_run_is_signed_and_verify_says_by_whom(tmp_path, key):
    folder = sealed(tmp_path)
    report = verify(folder, decode_run, [key.public])
    assert report.passed and report.signed_by == "Bench 3, Laboratory"
    assert report.signed.startswith("run:run\tsealed:")
    unknown = verify(folder, decode_run)
    assert unknown.passed and (unknown.signed_by, unknown.unknown_key) == ("", key.public.line)


def test_who_makes_everything_anew_without_the_key_is_found_by_those_who_ask_for_it(tmp_path, key):
    folder = sealed(tmp_path)
    manifest = read_manifest(folder).model_copy(update={"units": {"fog_1": "another"}, "key": "", "seal": ""})
    seal(folder, manifest, None, outcome="completed")
    assert problems(folder, key.public) == {}  # nothing but the key tells
    assert problems(folder, key.public, must=True) == {"manifest.json": "is not signed"}
    seal(folder, manifest, SigningKey.new("Bench 3, Laboratory"), outcome="completed")
    assert list(problems(folder, key.public, must=True)) == ["manifest.json.minisig"]
    assert verify(folder, decode_run, [key.public]).signed_by == ""


def test_a_manifest_changed_under_its_signature_or_without_it_is_found(tmp_path, key):
    folder = sealed(tmp_path)
    copy = shutil.copytree(folder, tmp_path / "copy")
    path = copy / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b'"F"', b'"G"'))
    assert problems(copy, key.public)["manifest.json.minisig"] == "the signature is not of these bytes"
    (folder / "manifest.json.minisig").unlink()
    assert list(problems(folder, key.public)) == ["manifest.json.minisig"]


def test_a_signature_beside_a_manifest_that_knows_of_none_is_found(tmp_path, key, monkeypatch):
    signature = (sealed(tmp_path) / "manifest.json.minisig").read_bytes()
    monkeypatch.setenv("GYROBENCH_KEY", "")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("GYROBENCH_KEY")
    folder = sealed(tmp_path, "plain")
    assert problems(folder) == {} and not read_manifest(folder).key
    (folder / "manifest.json.minisig").write_bytes(signature)
    assert list(problems(folder)) == ["manifest.json.minisig"]


def test_a_recovered_run_is_signed_too(tmp_path, key):
    record = RunRecord.create(tmp_path, "run", "test", {}, bench_file_from(FILE), None)
    for port in ("fog_1", "table", "chamber"):
        record.tap(port).received(b"abc", 0.5)
    record.stream_starts("fog_1", 0)
    record._journal.close()
    assert recover(tmp_path / "run").key == key.public.line
    assert problems(tmp_path / "run", key.public, must=True) == {}


@pytest.mark.parametrize("content", [b"", b"{}", b'{"format": 1, "name": "x", "id": "00", "seed": "00"}'])
def test_a_key_that_cannot_be_used_is_told_before_a_run_has_a_folder(tmp_path, key, content):
    key_file().write_bytes(content)
    with pytest.raises(ConfigurationError, match="the key of the bench cannot be used"):
        RunRecord.create(tmp_path / "runs", "run", "test", {}, bench_file_from(FILE), None)
    assert not (tmp_path / "runs").exists()
    key_file().unlink()
    with pytest.raises(ConfigurationError):  # it was named: that it is missing is no reason to sign nothing
        bench_key()


def test_the_public_key_is_in_the_manifest_and_no_secret_is(tmp_path, key):
    folder = sealed(tmp_path)
    secret = json.loads(key_file().read_text())["seed"]
    held = b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())
    assert secret.encode() not in held and bytes.fromhex(secret) not in held
    assert read_manifest(folder).key == key.public.line
