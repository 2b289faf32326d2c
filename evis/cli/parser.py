"""Parses the arguments of all commands: one line for an error, the example at the end of the help."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from evis.config.suggestions import closest, did_you_mean
from evis.console.printable import printable

KINDS = {"float": "a number", "int": "a whole number"}
"""How argparse's own complaints name a type -> how a user does."""

PATHS = {
    "BAG": "a file such as run.mcap",
    "BAG|FILE": "a bag or a recording",
    "DIR": "a folder",
    "FILE": "a file",
    "FILE|NAME": "a file, or one that comes with evis",
    "FRAMES": "a file or a folder",
    "IN": "a file",
    "OUT": "what to write",
    "PREFIX": "what the names of files are to begin with",
    "REC": "a file",
    "RECIPE": "a recipe",
    "RECORDING": "a file",
}
"""How the help calls a value that is a path -> what it is to be. An empty text would be the folder that one is in."""

SURE = 0.75
"""Likeness from which on an option is meant where an argument of a graph may be, 0 ... 1."""


class UsageError(ValueError):
    """Reports a command line that is understood but wrong: exit status 2."""


def check_duration(seconds: float | None) -> None:
    """Raises UsageError for a `--duration` that is no time [s]. None: there is none."""
    if seconds is not None and not 0 < seconds < 1e9:
        raise UsageError(f"--duration is {seconds:g}; it must be a time longer than 0 and less than 1e9 s")


class Parser(argparse.ArgumentParser):
    """Parses the words of one command. `words`: the command line, for a help text that depends on it."""

    def __init__(
        self, prog: str = "", description: str = "", epilog: str = "", words: Sequence[str] = (), **kwargs: Any
    ) -> None:
        kwargs.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(prog=prog, description=description, epilog=epilog, allow_abbrev=False, **kwargs)
        self.words = list(words)

    def add_argument(self, *args: Any, **kwargs: Any) -> argparse.Action:
        """Adds an argument as argparse does; what may be left out is not called missing beside something that is."""
        action = super().add_argument(*args, **kwargs)
        if action.nargs in (argparse.ZERO_OR_MORE, argparse.REMAINDER):
            action.required = False
        return action

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parses as argparse does, with _ for - in names of options, as `evis launch` has it in its arguments; an
        option that there is not is an error before one that is missing.
        """
        words = None if args is None else [self._spelled(word) for word in args]
        # Not where another parser takes what follows, an action's or another command's.
        if words is not None and not any(
            action.nargs in (argparse.PARSER, argparse.REMAINDER) for action in self._actions
        ):
            for at, word in enumerate(words[: words.index("--")] if "--" in words else words):
                name, _, value = word.partition("=")
                if word.startswith("--") and name not in self._option_string_actions:
                    self.error(f"no option '{name}'{self._instead(name, value or ' '.join(words[at + 1 : at + 2]))}")
        parsed, rest = super().parse_known_args(words, namespace)
        self._check_paths(parsed)
        return parsed, rest

    def _check_paths(self, parsed: argparse.Namespace) -> None:
        """Ends with an error where a path that was given is an empty text, as of a shell's variable that is not set."""
        for action in self._actions:
            what = PATHS.get(action.metavar) if isinstance(action.metavar, str) else None
            given = getattr(parsed, action.dest, None)
            if what is not None and "" in (given if isinstance(given, list) else [given]):
                name = next((name for name in action.option_strings if name.startswith("--")), action.metavar)
                leave = ", or leave it out" if action.option_strings and not action.required else ""
                self.error(f"{name} is empty; name {what}{leave}")

    def _spelled(self, word: str) -> str:
        name, equals, value = word.partition("=")
        hyphened = name.replace("_", "-")
        return hyphened + equals + value if word.startswith("--") and hyphened in self._option_string_actions else word

    def _instead(self, name: str, value: str) -> str:
        """What may be meant by an option that there is not; an argument of a graph is one only when it is near."""
        if not any(action.dest == "pairs" for action in self._actions):
            return did_you_mean(name, self._option_string_actions)
        near = closest(name, self._option_string_actions, SURE)
        key = name.removeprefix("--").replace("-", "_")
        return f"; did you mean '{near}'?" if near else f"; an argument is written {key}:={value or 'VALUE'}"

    def error(self, message: str) -> NoReturn:
        """Prints one line, and exits with status 2."""
        text = self._missing_action(message) or _in_words(message)
        print(f"{self.prog}: {printable(text)} ({self.prog} --help tells more)", file=sys.stderr)
        raise SystemExit(2)

    def _missing_action(self, message: str) -> str:
        """What may follow, where a command's action is missing; "" for any other complaint."""
        if not message.endswith("required: ACTION"):
            return ""
        names = next(list(action.choices or ()) for action in self._actions if action.nargs == argparse.PARSER)
        return f"which ACTION? {', '.join(names)}"


def _in_words(message: str) -> str:
    """argparse's complaint about a value as the rest of the program would say it."""
    if wrong := re.fullmatch(r"argument ([^:]+): invalid (float|int) value: ('.*')", message):
        return f"{wrong[1]} is {wrong[3]}, must be {KINDS[wrong[2]]}"
    if wrong := re.fullmatch(r"argument ([^:]+): invalid choice: '(.*)' \(choose from (.*)\)", message):
        known = re.findall(r"[\w-]+", wrong[3])
        hint = did_you_mean(wrong[2], known)
        return f"{wrong[1]} is '{wrong[2]}', must be one of {', '.join(known)}{hint}"
    return message
