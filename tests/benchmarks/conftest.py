"""Makes the folder `benchmarks`, which is not installed, importable; xDSL installs a package of the same name."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))
