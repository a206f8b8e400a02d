"""The commands of `gcs`: name, module and first sentence of each, and the texts that need no more than these.

Nothing heavy is imported here: `gcs --help`, `gcs --version` and `gcs` alone are answered from this table. A test holds
the sentences against the docstrings of the commands.
"""

from __future__ import annotations

import os
import textwrap
from pathlib import Path
from typing import NamedTuple

PANELS = {  # of `gcs --help`, by the folder of the command
    "planning": "Planning: scenarios and plans",
    "missions": "Missions: files, and what vehicles have on board",
    "flights": "Flights: vehicles and recordings",
}
EXAMPLES = (
    "gcs fly simulation1 --sim",
    "gcs new plans/first",
    "gcs plan plans/first",
    "gcs schema > scenario.schema.json",
)
SUMMARY = "Plan, verify and fly formations of quadrotors over MAVLink."
FIRST_STEPS = """Plan, verify and fly formations of quadrotors over MAVLink. First steps:

  gcs fly simulation1 --sim    Fly six emulated vehicles and judge the flight.
  gcs new plans/first          Write a short scenario of your own.
  gcs plan plans/first         Plan it, verify the plan and write plans/first.skein.
  gcs show plans/first         Show what is in it: vehicles, limits, pads.

All commands: gcs --help. One command with its options and examples: gcs plan --help."""
_OPTIONS = {
    "--version": "Print the version, and the commit that it was built from.",
    "--install-completion": "Install completion for the current shell.",
    "--show-completion": "Show completion for the current shell, to copy it or customize the installation.",
    "--help, -h": "Show this message and exit.",
}
_WIDTH_MAX, _WIDTH_MIN, _NAME = 100, 60, 24
_HASH = 9  # digits of a commit that are printed


class CommandRow(NamedTuple):
    """One command: its function is named as the command is, with `_` for `-`."""

    name: str
    module: str
    summary: str

    @property
    def panel(self) -> str:
        """The heading under which `gcs --help` lists it."""
        return PANELS[self.module.split(".")[2]]


COMMANDS = {
    row.name: row
    for row in (
        CommandRow(
            "new",
            "gcs.cli.planning.new",
            "Write a short scenario that plans at once.",
        ),
        CommandRow(
            "new-vehicle",
            "gcs.cli.planning.new_vehicle",
            "Write a vehicle file for scenarios, estimated from mass, propellers, size, hover throttle and battery.",
        ),
        CommandRow(
            "show",
            "gcs.cli.planning.show",
            "Show the content of a scenario or plan: vehicles, start, end, limits, pads.",
        ),
        CommandRow(
            "plan",
            "gcs.cli.planning.plan",
            "Plan a mission, verify the plan and write it.",
        ),
        CommandRow(
            "replan",
            "gcs.cli.planning.replan",
            "Plan the remaining flight again, from the leader's state at a time, around new no-fly disks; verify and "
            "write it.",
        ),
        CommandRow(
            "returns",
            "gcs.cli.planning.prepare_returns",
            "Plan returns of the whole formation for instants along a plan, verify them and keep them in its file.",
        ),
        CommandRow(
            "check-events",
            "gcs.cli.planning.check_events",
            "Plan the answers to a scenario's events from instants along its plan, and verify them.",
        ),
        CommandRow(
            "verify",
            "gcs.cli.planning.plan",
            "Prove a plan again and list the least margin of every criterion, and the greatest wind by direction.",
        ),
        CommandRow(
            "prove",
            "gcs.cli.planning.prove_tracks",
            "Prove trajectories of any planner at every instant: separation, motion, thrust, heights, ground, zones.",
        ),
        CommandRow(
            "schema",
            "gcs.cli.planning.new",
            "Print the JSON Schema of scenario.toml, for editors that complete TOML.",
        ),
        CommandRow(
            "export",
            "gcs.cli.missions.export",
            "Write missions, setpoints and maps of every vehicle, for other ground stations.",
        ),
        CommandRow(
            "check",
            "gcs.cli.missions.check",
            "Check missions: separation at equal time, ground, fence, rally points, speeds, jumps, unsupported "
            "commands.",
        ),
        CommandRow(
            "upload",
            "gcs.cli.missions.upload",
            "Upload missions, fences, rally points and parameters to all vehicles, read them back and compare.",
        ),
        CommandRow(
            "download",
            "gcs.cli.missions.download",
            "Read missions, fences and rally points of every vehicle on a link into files uavN.plan.",
        ),
        CommandRow(
            "diff",
            "gcs.cli.missions.download",
            "Compare what vehicles have on board with a plan; change nothing.",
        ),
        CommandRow(
            "restore",
            "gcs.cli.missions.upload",
            "Give back what was on board before an upload: parameters, missions, fences and rally points.",
        ),
        CommandRow(
            "fly",
            "gcs.cli.flights.fly",
            "Plan a mission, upload it to every vehicle, read it back, fly it and judge the flight.",
        ),
        CommandRow(
            "refly",
            "gcs.cli.flights.refly",
            "Fly an emulated flight again, and say whether the true states are the same to the last bit.",
        ),
        CommandRow(
            "campaign",
            "gcs.cli.flights.campaign",
            "Fly a mission many times, emulated, in drawn wind, gusts and faults; the same command goes on where it "
            "ended.",
        ),
        CommandRow(
            "campaign-report",
            "gcs.cli.flights.campaign_report",
            "Show a campaign's pass rates, quantiles, effects and worst flights, also while it flies.",
        ),
        CommandRow(
            "attach",
            "gcs.cli.flights.attach",
            "Find a flight whose `gcs fly` was killed, show its vehicles, and land, return or resume it.",
        ),
        CommandRow(
            "report",
            "gcs.cli.flights.report",
            "Compare the planned, the reported and, for emulated vehicles, the true positions of a flight.",
        ),
        CommandRow(
            "replay",
            "gcs.cli.flights.replay",
            "Show a recorded flight: positions, modes and events over time.",
        ),
        CommandRow(
            "vehicles",
            "gcs.cli.flights.vehicles",
            "List the vehicles on a link: autopilot, version, mode, health, home, battery, link quality.",
        ),
        CommandRow(
            "tell",
            "gcs.cli.flights.tell",
            "Give an order to a flight under way: change its plan, or have vehicles hold, land or return one by one.",
        ),
    )
}


def help_text() -> str:
    """What `gcs --help` prints: every command with its first sentence, by folder, and the bundled missions."""
    from gcs.scenario.sources.bundled_missions import bundled_names

    lines = ["Usage: gcs [OPTIONS] COMMAND [ARGS]...", "", SUMMARY, "", "Options", *_listed(_OPTIONS)]
    for title in PANELS.values():
        lines += ["", title, *_listed({row.name: row.summary for row in COMMANDS.values() if row.panel == title})]
    if bundled := bundled_names():
        lines += ["", "Missions that come with Skein", *_indented(", ".join(bundled))]
    lines += ["", "One command with its options and examples: gcs plan --help", "", "Examples:"]
    return "\n".join([*lines, *(f"  {example}" for example in EXAMPLES)])


def version_text() -> str:
    """The version, and the commit where it is known."""
    from importlib.metadata import version

    commit = _commit()
    return f"gcs {version('skein-gcs')}" + (f" (commit {commit[:_HASH]})" if commit else "")


def _indented(text: str) -> list[str]:
    return textwrap.wrap(
        text, max(_WIDTH_MIN, min(_WIDTH_MAX, _columns())), initial_indent="  ", subsequent_indent="  "
    )


def _listed(rows: dict[str, str]) -> list[str]:
    width = max(_WIDTH_MIN, min(_WIDTH_MAX, _columns()))
    return [
        line
        for name, text in rows.items()
        for line in textwrap.wrap(
            text,
            width,
            initial_indent=f"  {name:{_NAME}}",
            subsequent_indent=" " * (_NAME + 2),
        )
    ]


def _columns() -> int:
    try:
        return int(os.environ.get("COLUMNS", "")) if "COLUMNS" in os.environ else os.get_terminal_size().columns
    except (OSError, ValueError, AttributeError):
        return 80


def _commit() -> str:
    """The commit that a wheel was built from, or that of the tree that this program runs from; empty if unknown."""
    package = Path(__file__).resolve().parents[1]
    try:
        built_from = package / "commit.txt"  # `tools/built_from.py` writes it
        if built_from.is_file():
            return built_from.read_text(encoding="ascii").strip()
        if not (package.parent / ".git").exists():
            return ""
        import subprocess

        asked = ["git", "-C", str(package.parent), "rev-parse", "HEAD"]
        return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, ValueError, subprocess.CalledProcessError):
        return ""
