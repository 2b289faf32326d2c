"""Hides what must not leave a run: the values of secret parameters, taken out of whatever others may read."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TextIO
from urllib.parse import quote

HIDDEN = "<secret>"
"""What stands where a secret stood."""
LEAST = 8
"""Shortest secret [characters]: a shorter one would be found in words that have nothing to do with it."""
MOST = 4096
"""Longest secret read from a file [characters]."""
_SOURCES = ("env:", "file:")


class SecretError(ValueError):
    """Says that a secret cannot be had. The text does not show it."""


class Redactor:
    """Takes secrets out of texts, and out of what is made of texts, also where they are only a part (an address)."""

    def __init__(self, secrets: Iterable[str] = ()) -> None:
        self._forms: list[str] = []
        for secret in secrets:
            self.add(secret)

    def add(self, secret: str) -> None:
        """Adds one secret."""
        if len(secret) < LEAST:
            return  # Param takes none so short
        forms = {secret, quote(secret), quote(secret, safe=""), json.dumps(secret)[1:-1], repr(secret)[1:-1]}
        # The longest first: of two secrets of which one begins like the other, nothing is left.
        self._forms = sorted({*self._forms, *forms}, key=len, reverse=True)

    def text(self, text: str) -> str:
        """Returns `text` with HIDDEN for every secret in it."""
        for form in self._forms:
            text = text.replace(form, HIDDEN)
        return text

    def value(self, value: Any) -> Any:
        """Replaces secrets in a value as `text` does: maps (keys too), lists and data classes are gone through, other
        numbers stay.
        """
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, dict):
            return {self.value(key): self.value(item) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            items = [self.value(item) for item in value]
            return items if isinstance(value, list) else tuple(items)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return dataclasses.replace(value, **{k: self.value(v) for k, v in vars(value).items()})
        if isinstance(value, int) and str(value) in self._forms:
            return HIDDEN  # YAML takes a secret of digits for a number
        return value


class Veil:
    """Passes text on to a stream without secrets: for what libraries and nodes print, piece by piece as it is
    written.
    """

    def __init__(self, stream: TextIO, redactor: Redactor) -> None:
        self._stream = stream
        self._redactor = redactor

    def write(self, text: str) -> int:
        """Writes the text without secrets to the stream behind."""
        self._stream.write(self._redactor.text(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def fetch(given: str) -> str:
    """Fetches the secret that is meant: `given` itself, or what `env:NAME` or `file:PATH` (its first line) hold.

    Raises SecretError.
    """
    source = next((source for source in _SOURCES if given.startswith(source)), "")
    name = given.removeprefix(source)
    if not source:
        secret = given
    elif source == "env:":
        if name not in os.environ:
            raise SecretError(f"environment variable {name} is not set")
        secret = os.environ[name]
    else:
        secret = _first_line(name)
    if source and secret.startswith(_SOURCES):
        raise SecretError(f"what stands in {given} begins with env: or file: itself")
    if len(secret) < LEAST:
        raise SecretError(f"a secret of {len(secret)} characters, the least is {LEAST}")
    return secret


def _first_line(name: str) -> str:
    path = Path(os.path.expanduser(name))  # as it stands where there is no such user
    try:
        with open(path, encoding="utf-8") as file:
            line = file.readline(MOST + 1).rstrip("\r\n")
    except OSError as error:
        raise SecretError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SecretError(f"{path}: its first line is not UTF-8 text") from None
    if len(line) > MOST:
        raise SecretError(f"{path}: its first line is longer than {MOST} characters")
    return line
