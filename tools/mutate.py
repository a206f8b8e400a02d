"""Mutation testing with mutmut, in a copy of the tree: change one operator or constant at a time, run tests, list those
changes that no test noticed.

    ./tools/run python tools/mutate.py gcs/link/mission_protocol/read_back.py \\
        --tests tests/unit/link/mission_protocol/test_read_back.py [--sample 100] [--to FOLDER]

Only the bodies of functions are changed: tables and constants of a module are not. mutmut is installed into the folder,
with pip: it is no dependency of the project. A second run goes on where one ended.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MUTMUT = "mutmut==3.8.1"
PARTS = ("gcs", "sim_bridge", "tools", "tests", "missions", "docs", "pyproject.toml")


def settings(modules: list[str], tests: list[str], but: str) -> str:
    """The table of mutmut for these modules and tests."""
    options = ["-n0", "-o", "addopts=--import-mode=importlib", "-x", "-q", *(["-k", but] if but else [])]
    rows = {
        "source_paths": ["gcs"],
        "only_mutate": modules,
        "also_copy": ["sim_bridge", "tools", "missions", "docs"],
        "pytest_add_cli_args": options,
        "pytest_add_cli_args_test_selection": tests,
    }
    lines = [f"{key} = {json.dumps(value)}" for key, value in rows.items()]
    lines += ["use_git_change_detection = false", "timeout_multiplier = 10.0", "timeout_constant = 3.0"]
    return "\n\n[tool.mutmut]\n" + "\n".join(lines) + "\n"


def main() -> int:
    """Run it."""
    cli = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    cli.add_argument("modules", nargs="+", help="files or patterns of the code to change")
    cli.add_argument("--tests", nargs="+", required=True, help="what is run for each change")
    cli.add_argument("-k", dest="but", default="", help="tests of these only, as pytest's -k")
    cli.add_argument("--sample", type=int, help="so many changes at most, chosen by chance, always the same ones")
    cli.add_argument("--to", type=Path, default=Path(tempfile.gettempdir()) / "skein-mutants")
    asked = cli.parse_args()
    tree, library = asked.to / "tree", asked.to / "mutmut"
    for name in PARTS:
        target = tree / name
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copyfile(ROOT / name, target)
    with (tree / "pyproject.toml").open("a", encoding="utf-8") as file:
        file.write(settings(asked.modules, asked.tests, asked.but))
    if not library.exists():
        subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--target", library, MUTMUT], check=True)
    environment = {**os.environ, "PYTHONPATH": str(library)}
    command = [sys.executable, "-m", "mutmut"]
    run = [*command, "run", "--max-children", "1"]
    if asked.sample:
        subprocess.run([*run, "none"], cwd=tree, env=environment, check=False, capture_output=True)  # writes them only
        known = [json.loads(file.read_text())["exit_code_by_key"] for file in (tree / "mutants").rglob("*.meta")]
        names = sorted(name for names in known for name in names)
        print(f"{len(names)} changes are known")
        run += random.Random(1).sample(names, min(asked.sample, len(names)))
    subprocess.run(run, cwd=tree, env=environment, check=False)
    return subprocess.run([*command, "results"], cwd=tree, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
