"""Makes and reads CURVE keys, as files in the form of ZeroMQ's certificates."""

from __future__ import annotations

import os
import stat
from dataclasses import dataclass
from pathlib import Path

import zmq
from zmq.utils import z85

PUBLIC, SECRET = ".key", ".key_secret"
"""Endings of the two files of a pair, as zmq.auth has them."""
_LONGEST = 1 << 16
"""Longest file that is read [bytes]: a key is two lines, with any metadata beside it."""
_DIGITS = 40
"""Characters of a key in Z85."""


class KeyFileError(ValueError):
    """Reports a key file that cannot be used; the text names it and the remedy."""


@dataclass(frozen=True)
class KeyPair:
    """Holds a public and a secret key, as 40 characters of Z85 each."""

    public: bytes
    secret: bytes


def make_pair(name: str) -> tuple[Path, Path]:
    """Makes `name.key`, to be given to others, and `name.key_secret`; both are readable by their user alone.

    Raises KeyFileError where one of them is there already, which is left as it is, and OSError.
    """
    public, secret = Path(name + PUBLIC), Path(name + SECRET)
    for path in (public, secret):
        if path.exists() or path.is_symlink():
            raise KeyFileError(f"{path} is there already, and keys are never overwritten; choose another name")
    keys = KeyPair(*zmq.curve_keypair())
    _write(secret, [f'    public-key = "{keys.public.decode()}"', f'    secret-key = "{keys.secret.decode()}"'])
    try:
        _write(public, [f'    public-key = "{keys.public.decode()}"'])
    except OSError:
        secret.unlink()  # half a pair is of no use
        raise
    return public, secret


def _write(path: Path, lines: list[str]) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o600)
    with open(descriptor, "w") as file:
        file.write("\n".join(["metadata", "curve", *lines, ""]))


def read_public(path: Path) -> bytes:
    """Reads the public key of a file of either kind. Raises KeyFileError and OSError."""
    return _key(path, _fields(path), "public-key")


def read_pair(path: Path) -> KeyPair:
    """Reads both keys of a secret file. Raises KeyFileError, for a file that others can read too, and OSError."""
    fields = _fields(path)
    if "secret-key" not in fields:
        raise KeyFileError(f"{path} has no secret key; give the file of the pair that ends in {SECRET}")
    if stat.S_IMODE(path.stat().st_mode) & 0o077:
        raise KeyFileError(f"{path} can be read by others, and a secret key must not: chmod 600 {path}")
    pair = KeyPair(_key(path, fields, "public-key"), _key(path, fields, "secret-key"))
    if zmq.curve_public(pair.secret) != pair.public:
        raise KeyFileError(f"{path}: its two keys are no pair; `evis remote keys NAME` makes one")
    return pair


def _fields(path: Path) -> dict[str, str]:
    if path.exists() and not path.is_file():
        raise KeyFileError(f"{path} is no file; `evis remote keys NAME` makes NAME{PUBLIC} and NAME{SECRET}")
    try:
        with open(path, "rb") as file:
            text = file.read(_LONGEST).decode("ascii")
    except FileNotFoundError:
        raise KeyFileError(
            f"{path}: no such file; `evis remote keys NAME` makes NAME{PUBLIC} and NAME{SECRET}"
        ) from None
    except UnicodeDecodeError:
        text = ""
    pairs = [line.partition("=") for line in text.splitlines() if "=" in line]
    return {name.strip(): value.strip().strip('"') for name, _, value in pairs}


def _key(path: Path, fields: dict[str, str], name: str) -> bytes:
    key = fields.get(name, "").encode()
    try:
        if len(key) == _DIGITS and len(z85.decode(key)) == 32:
            return key
    except (KeyError, ValueError):  # a character that Z85 has not
        pass
    raise KeyFileError(f"{path} holds no {name.replace('-', ' ')}; `evis remote keys NAME` makes a pair")
