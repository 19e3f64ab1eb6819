"""Signatures by a key of the bench: Ed25519 (RFC 8032) in the file format of minisign, whose tool can check them.

A bench that has a key signs what it seals. The secret key is a file that its account alone can read; the public
key is two lines of text that are given to whoever is to check.

Sources: RFC 8032; the page "Minisign" by F. Denis, sections "Signature format" and "Public key format".
"""

from __future__ import annotations

import base64
import hashlib
import json
import os
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from drivers.base.clock import utc_now
from drivers.base.errors import ConfigurationError, RecordError
from drivers.base.files import SETTINGS_BYTES, parse_json, read_bounded, replace_file
from drivers.base.system import state_folder

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

KEY_VARIABLE = "GYROBENCH_KEY"
SUFFIX = ".minisig"
_LEGACY, _PREHASHED = b"Ed", b"ED"
_ID_BYTES, _KEY_BYTES, _SIGNATURE_BYTES = 8, 32, 64
_LONGEST_NAME = 100


class NotSigned(Exception):
    """A signature that is missing, damaged, or of other bytes or another key; its text says which."""


def _ed25519() -> Any:
    try:
        from cryptography.hazmat.primitives.asymmetric import ed25519
    except ImportError as error:
        raise ConfigurationError(
            "signatures need the package cryptography",
            expected="gyrobench with its extra `sign`",
            remedy="pip install 'gyrobench[sign]', or take the key away: runs are then sealed unsigned",
        ) from error
    return ed25519


@dataclass(frozen=True)
class PublicKey:
    """A key that signatures are checked with: its id (8 bytes), the key (32 bytes), and whose it says it is."""

    identity: bytes
    raw: bytes
    name: str = ""

    @classmethod
    def from_text(cls, text: str) -> PublicKey:
        """Return the key of a public key file, or of its second line alone; ConfigurationError if it is none."""
        *comments, line = [part.strip() for part in text.strip().splitlines()] or [""]
        try:
            data = base64.b64decode(line, validate=True)
        except ValueError:
            data = b""
        if not data.startswith(_LEGACY) or len(data) != len(_LEGACY) + _ID_BYTES + _KEY_BYTES:
            raise ConfigurationError(
                "this is no public key", found=line[:80] or "nothing", expected="a minisign public key, RW..."
            )
        name = comments[0].partition(":")[2].strip()[:_LONGEST_NAME] if comments else ""
        return cls(data[2:10], data[10:], name)

    @property
    def line(self) -> str:
        """The key in a line, as minisign's -P takes it."""
        return base64.b64encode(_LEGACY + self.identity + self.raw).decode("ascii")

    @property
    def text(self) -> str:
        """The public key file."""
        return f"untrusted comment: {self.name}\n{self.line}\n"

    def check(self, content: bytes, signature: str) -> str:
        """Return the trusted comment of a signature of `content` by this key; NotSigned if it is none."""
        try:
            _, first, comment, second = signature.splitlines()
            data, whole = (base64.b64decode(line, validate=True) for line in (first, second))
        except ValueError as error:
            raise NotSigned("the signature is damaged") from error
        if data[2:10] != self.identity:
            raise NotSigned("it is signed by another key")
        signed = hashlib.blake2b(content).digest() if data[:2] == _PREHASHED else content
        told = comment.removeprefix("trusted comment: ")
        from cryptography.exceptions import InvalidSignature

        key = _ed25519().Ed25519PublicKey.from_public_bytes(self.raw)
        try:
            key.verify(data[10:], signed)
            key.verify(whole, data[10:] + told.encode())
        except InvalidSignature as error:
            raise NotSigned("the signature is not of these bytes") from error
        return told


@dataclass(frozen=True, repr=False)
class SigningKey:
    """The secret key of a bench."""

    public: PublicKey
    _seed: bytes

    @classmethod
    def new(cls, name: str) -> SigningKey:
        """Return a new key; ConfigurationError for a name that is none."""
        name = name.strip()
        if not name or len(name) > _LONGEST_NAME or not name.isprintable():
            raise ConfigurationError(
                "a key without a name",
                found=repr(name)[:80],
                expected="whose it is, in a line: bench and laboratory",
            )
        return cls._of(name, secrets.token_bytes(_ID_BYTES), secrets.token_bytes(_KEY_BYTES))

    @classmethod
    def _of(cls, name: str, identity: bytes, seed: bytes) -> SigningKey:
        raw = _private(seed).public_key().public_bytes_raw()
        return cls(PublicKey(identity, raw, name), seed)

    @classmethod
    def load(cls, path: Path) -> SigningKey:
        """Read a key file; ConfigurationError if it cannot be read or is none."""
        try:
            data = parse_json(read_bounded(path, SETTINGS_BYTES))
            if data["format"] != 1:
                raise ValueError(f"format {data['format']!r}")
            identity, seed = bytes.fromhex(data["id"]), bytes.fromhex(data["seed"])
            if (len(identity), len(seed)) != (_ID_BYTES, _KEY_BYTES):
                raise ValueError("id or seed of another length")
            return cls._of(str(data["name"]), identity, seed)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(
                "the key of the bench cannot be used",
                where=str(path),
                found=f"{type(error).__name__}: {error}",
                expected="a file that `gyrobench key make` made, readable by this account",
                remedy="restore it, or take it away: runs are then sealed without a signature",
            ) from error

    def save(self, path: Path) -> None:
        """Write the key file, for its owner alone to read, and FILE.pub. ConfigurationError if there is one."""
        if path.exists():
            raise ConfigurationError(
                "there is a key already",
                where=str(path),
                expected="no file of that name: what an older key signed is checked with that key",
                remedy="move it away if it is to sign no more, and keep its public key",
            )
        data = {
            "format": 1,
            "name": self.public.name,
            "id": self.public.identity.hex(),
            "seed": self._seed.hex(),
        }
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, json.dumps(data, indent=1) + "\n", mode=0o600)
            replace_file(public_key_file(path), self.public.text)
        except OSError as error:
            raise ConfigurationError(
                "the key cannot be kept", where=str(path), found=error.strerror or str(error)
            ) from error

    def sign(self, content: bytes, comment: str) -> str:
        """Return the signature file of some bytes; `comment`, a line, is signed with them."""
        key = _private(self._seed)
        signature = key.sign(hashlib.blake2b(content).digest())
        first = base64.b64encode(_PREHASHED + self.public.identity + signature).decode("ascii")
        second = base64.b64encode(key.sign(signature + comment.encode())).decode("ascii")
        return f"untrusted comment: signed by {self.public.name}\n{first}\ntrusted comment: {comment}\n{second}\n"


def _private(seed: bytes) -> Ed25519PrivateKey:
    key: Ed25519PrivateKey = _ed25519().Ed25519PrivateKey.from_private_bytes(seed)
    return key


def key_file() -> Path:
    """Return where the bench's key is: `$GYROBENCH_KEY`, else `signing.key` in the state folder."""
    named = os.environ.get(KEY_VARIABLE, "")
    return Path(named) if named else state_folder() / "signing.key"


def public_key_file(path: Path | None = None) -> Path:
    """Return where the public key lies: beside the key."""
    path = path or key_file()
    return path.with_name(f"{path.name}.pub")


def bench_key() -> SigningKey | None:
    """Return the key that this bench signs with; None if it has none. ConfigurationError if it cannot be used."""
    path = key_file()
    return SigningKey.load(path) if path.exists() or KEY_VARIABLE in os.environ else None


def known_keys(files: Sequence[Path] | None) -> list[PublicKey]:
    """Return the public keys of files; without any, that of this bench if it has one. ConfigurationError."""
    if files:
        return [read_public_key(path) for path in files]
    path = public_key_file()
    return [read_public_key(path)] if path.exists() else []


def read_public_key(path: Path) -> PublicKey:
    """Read a public key file; ConfigurationError if it cannot be read or is none."""
    try:
        return PublicKey.from_text(read_bounded(path, SETTINGS_BYTES).decode("utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "the public key cannot be read", where=str(path), found=str(error)
        ) from error


def signature_file(path: Path) -> Path:
    """Return where the signature of a file lies: beside it."""
    return path.with_name(path.name + SUFFIX)


def sign_file(path: Path, key: SigningKey) -> Path:
    """Sign a file; return its signature's file. RecordError if one cannot be read or the other not be written."""
    target = signature_file(path)
    try:
        replace_file(
            target, key.sign(path.read_bytes(), f"file:{path.name}\tsigned:{utc_now()}\tby:{key.public.name}")
        )
    except OSError as error:
        raise RecordError(
            "the file cannot be signed", where=str(path), found=error.strerror or str(error)
        ) from error
    return target


def check_file(path: Path, keys: Sequence[PublicKey]) -> tuple[PublicKey, str]:
    """Return by which of the keys a file is signed, and the comment that was signed with it; NotSigned."""
    try:
        content = path.read_bytes()
        signature = read_bounded(signature_file(path), SETTINGS_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise NotSigned(f"it has no signature that can be read ({error})") from error
    why = "no key to check it with"
    for key in keys:
        try:
            return key, key.check(content, signature)
        except NotSigned as error:
            why = str(error)
    raise NotSigned(why)
