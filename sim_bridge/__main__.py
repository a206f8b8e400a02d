"""`python -m sim_bridge` is `sim-bridge`."""

import sys

from sim_bridge.cli import run

sys.exit(run())
