"""Orders on the page of a flight: said in numbers, confirmed by keyboard, decided by the policy, obeyed."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from gcs.plan.trajectory.plan import Plan
from tests.browser import CHROMIUM, WHY_NOT, Browser
from tests.kept import GCS

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason=WHY_NOT)]
ADDRESS = re.compile(r"page: (http://127\.0\.0\.1:\d+/\?token=[\w-]+)")
RESULT = "document.querySelector('.orders output').textContent"
SPEEDS = "skein.scene.newest.vehicles.map((one) => one.speed_mps)"


def order(page: Browser, word: str) -> str:
    """Order by keyboard alone: the button, what would happen, and the confirmation; return what was said."""
    page.value(f"{RESULT} = '', document.querySelector('[data-order={word}]').focus()")
    page.press("Enter")
    page.until("document.querySelector('dialog').open || " + RESULT, 20.0)
    assert page.value("document.querySelector('dialog').open"), page.value(RESULT)
    assert page.value("document.activeElement.className") == "cancel", "Enter twice gives no order"
    said: str = page.value("document.querySelector('dialog p').textContent")
    page.value("document.querySelector('dialog .give').focus()")
    page.press("Enter")
    assert page.until(RESULT, 20.0) == "ordered"
    return said


def test_all_hold_go_on_and_return_as_ordered_on_the_page(hop: Plan, hop_skein: Path, tmp_path: Path) -> None:
    flown = [*GCS, "fly", str(hop_skein), "--sim", "--speedup", "1", "--page", "--to", str(tmp_path)]
    with (
        subprocess.Popen(flown, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as command,
        Browser() as page,
    ):
        assert command.stdout is not None
        try:
            found = None
            while found is None:
                line = command.stdout.readline()
                assert line, "it ended"
                found = ADDRESS.search(line)
            page.go(found[1])
            page.until("skein.scene.newest.t_s > 4", 120.0)
            assert min(page.value(SPEEDS)) > 0.5
            said = order(page, "hold")
            assert said.startswith("vehicles 1, 2, 3 brake and hold until the next order; a minute takes ")
            page.until(f"Math.max(...{SPEEDS}) < 0.2", 30.0)
            assert "they continue at t = " in order(page, "continue")
            page.until(f"Math.min(...{SPEEDS}) > 0.5", 30.0)
            page.value("document.querySelector('td input[value=\"2\"]').click()")
            assert page.value("document.querySelector('.whom').textContent") == "orders to 2"
            assert re.match(r"vehicle 2 returns, at \d+ m, \d+ s, \d+ % battery; ", order(page, "return"))
            page.value("document.querySelector('td input[value=\"2\"]').click()")
            assert re.match(r"vehicles 1, 3 return, staggered \d+–\d+ m, \d+ s, \d+ % battery; ", order(page, "return"))
            page.until(
                "skein.scene.events.filter((one) => one.text.startsWith('ordered to return')).length === 3", 30.0
            )
            assert page.elsewhere() == [] and page.said == []
            page.go("about:blank")
            said = command.stdout.read()
            assert command.wait() == 9, said
            assert "return ordered by the page at 127.0.0.1" in said
        finally:
            command.kill()
    (folder,) = [one for one in tmp_path.iterdir() if one.is_dir()]
    events = [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]
    asked = [one["data"] for one in events if "asked to" in one["what"]]
    assert [(one["order"], one["vehicles"], one["by"]) for one in asked] == [
        ("hold", [1, 2, 3], "the page at 127.0.0.1"),
        ("continue", [1, 2, 3], "the page at 127.0.0.1"),
        ("return", [2], "the page at 127.0.0.1"),
        ("return", [1, 3], "the page at 127.0.0.1"),  # those that fly the plan: 2 returns already
    ]
    import numpy as np

    from gcs.flight.assessment.judge import load_truth
    from gcs.physics.states import POSITION

    ends = load_truth(folder / "truth.npz").states[:, -1, POSITION]
    assert np.linalg.norm((ends - hop.pads_ned_m)[:, :2], axis=1).max() < 2.0, "they stand on their pads"
