"""`python -m evis.cli` is `evis`."""

import sys

from evis.cli import main

sys.exit(main())
