"""How many attacks a campaign makes, and the table of attacks and what came of them.

EVIS_ADVERSARY_SHARE: part of the full number of attacks (1). EVIS_ADVERSARY_SEED: what they are drawn from (0).
EVIS_ADVERSARY_OUT: a folder that gets attacks.json and attacks.md.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

SHARE = float(os.environ.get("EVIS_ADVERSARY_SHARE", "1"))
SEED = int(os.environ.get("EVIS_ADVERSARY_SEED", "0"))
OUT = os.environ.get("EVIS_ADVERSARY_OUT", "")


def number(full: int) -> int:
    """Attacks to make of `full`, at least one."""
    return max(1, round(full * SHARE))


@dataclass
class Row:
    """One kind of attack: what came of each, how often, and what should not have been."""

    outcomes: Counter[str] = field(default_factory=Counter)
    failures: list[str] = field(default_factory=list)
    figures: dict[str, float] = field(default_factory=dict)


class Table:
    """Rows by (campaign, attack)."""

    def __init__(self) -> None:
        self.rows: dict[tuple[str, str], Row] = {}

    def row(self, campaign: str, attack: str) -> Row:
        """The row of that name, new if need be."""
        return self.rows.setdefault((campaign, attack), Row())

    def count(self, campaign: str, attack: str, outcome: str) -> None:
        """One more attack that ended as it may."""
        self.row(campaign, attack).outcomes[outcome] += 1
        self._write()

    def fail(self, campaign: str, attack: str, what: str) -> None:
        """One more attack that ended as none may. `what` says how to repeat it."""
        row = self.row(campaign, attack)
        row.outcomes["FAILED"] += 1
        row.failures.append(what)
        self._write()

    def most(self, campaign: str, attack: str, figure: str, value: float) -> None:
        """Keep the largest value of a figure."""
        figures = self.row(campaign, attack).figures
        figures[figure] = max(value, figures.get(figure, value))

    def failures(self, campaign: str) -> list[str]:
        """All of one campaign."""
        return [f"{attack}: {what}" for (name, attack), row in self.rows.items() if name == campaign
                for what in row.failures]  # fmt: skip

    def markdown(self) -> str:
        """For docs/reliability.md; failures one by one below it."""
        lines = ["| campaign | attack | times | what came of it |", "|---|---|---:|---|"]
        for (campaign, attack), row in self.rows.items():
            told = [f"{outcome} {n}" for outcome, n in row.outcomes.most_common()]
            told += [f"{name} {value:.3g}" for name, value in row.figures.items()]
            lines.append(f"| {campaign} | {attack} | {row.outcomes.total()} | {', '.join(told)} |")
        failed = [f"- {campaign}: {attack}: {what}" for (campaign, attack), row in self.rows.items()
                  for what in row.failures]  # fmt: skip
        return "\n".join([*lines, *(["", "Failed:", "", *failed] if failed else [])]) + "\n"

    def _write(self) -> None:
        if not OUT:
            return
        folder = Path(OUT)
        folder.mkdir(parents=True, exist_ok=True)
        rows = [{"campaign": campaign, "attack": attack, "times": row.outcomes.total(), "outcomes": row.outcomes,
                 "figures": row.figures, "failures": row.failures}
                for (campaign, attack), row in self.rows.items()]  # fmt: skip
        (folder / "attacks.json").write_text(json.dumps(rows, indent=1))
        (folder / "attacks.md").write_text(self.markdown())


TABLE = Table()
