"""`python -m sim_bridge`: the same as the `sim-bridge` command."""

import sys

from sim_bridge.cli import run

sys.exit(run())
