"""Coverage-guided fuzzing of one decoder: `python fuzz_atheris.py ENCODING -runs=N`. Needs the atheris package.

The first bytes of an input choose size, time limit and cuts; the rest is decoded by numpy (whose branches guide the
search) and by the kernel, which must agree.
"""

from __future__ import annotations

import sys
from pathlib import Path

import atheris

sys.path[:0] = [str(Path(__file__).parents[at]) for at in (3, 1, 0)]
with atheris.instrument_imports(include=["evis.events"]):
    import both_decoders


def one_input(data: bytes) -> None:
    """One input: two pieces, both back ends."""
    provider = atheris.FuzzedDataProvider(data)
    size = both_decoders.SIZES[provider.ConsumeIntInRange(0, 3)]
    limit, gap = provider.ConsumeIntInRange(-10, 1 << 40), provider.ConsumeIntInRange(0, 3)
    first = provider.ConsumeBytes(provider.ConsumeIntInRange(0, 200))
    both_decoders.run(encoding, size, [first, provider.ConsumeBytes(400)], limit, gap)


encoding = sys.argv.pop(1)
atheris.Setup(sys.argv, one_input)
atheris.Fuzz()
