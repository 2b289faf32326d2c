"""Runs `evis` as `python -m evis.cli`."""

import sys

from evis.cli import main

sys.exit(main())
