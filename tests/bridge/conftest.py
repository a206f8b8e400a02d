"""The fixtures that people get who test their own ground software, for our own tests of them."""

from sim_bridge.testing import fleet, make_fleet

__all__ = ["fleet", "make_fleet"]
