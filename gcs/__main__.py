"""`python -m gcs` is `gcs`."""

from __future__ import annotations

import sys

from gcs.cli.main import run

if __name__ == "__main__":
    sys.exit(run())
