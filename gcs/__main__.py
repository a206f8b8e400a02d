"""`python -m gcs` is `gcs`."""

import sys

from gcs.cli.main import run

if __name__ == "__main__":
    sys.exit(run())
