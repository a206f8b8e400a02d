"""The pictures of the documents, drawn from the scenarios: ./tools/run python tools/figures.py [MISSION ...]"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import gcs
from gcs.flight.plots.coverage_plot import save_coverage
from gcs.flight.plots.flight_plot import draw_map
from gcs.flight.plots.overview_plot import draw_plan
from gcs.physics.states import POSITION
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from tools.pictures.change import draw_change
from tools.pictures.film import write_film
from tools.pictures.flight import draw_flight
from tools.pictures.gallery import write_gallery
from tools.pictures.live import write_page
from tools.pictures.live_change import write_proposal
from tools.pictures.page_film import write_page_film
from tools.pictures.scenery import save
from tools.pictures.tutorial import write_pictures
from tools.pictures.view import camera_near, draw_view

ROOT = Path(__file__).resolve().parent.parent
STEP_S = 0.1
CLOSE_UP_S = 228.0


def simulation1(plan: Plan, folder: Path) -> Iterator[Path]:
    """The formation close up behind the highest mountain of its track, and the map."""
    camera = camera_near(plan, CLOSE_UP_S, (4.6, 3.4, 1.55), turn_deg=10.0)
    yield save(draw_view(plan, CLOSE_UP_S, camera), folder / "close_up.png")
    t_s = np.arange(plan.t_start_s, plan.t_end_s, STEP_S)
    yield save(draw_map(plan.scenario, plan.sysids, t_s, plan.states(t_s)[..., POSITION]), folder / "map.png")


def changes(plan: Plan, folder: Path) -> Iterator[Path]:
    """The flight, and each change in the formation's own frame; the second of a kind is numbered."""
    yield save(draw_flight(plan), folder / "map.png")
    kinds: list[str] = []
    for move in plan.moves:
        kinds.append(move.kind)
        again = kinds.count(move.kind)
        yield save(draw_change(plan, move), folder / f"{move.kind}{again if again > 1 else ''}.png")


def whole(plan: Plan, folder: Path) -> Iterator[Path]:
    """The map, the curves over time and the shapes: what `gcs show --picture` draws."""
    yield save(draw_plan(plan), folder / "map.png")


def gap(plan: Plan, folder: Path) -> Iterator[Path]:
    """The flight beside that of the rigid formation, and a film."""
    yield save(draw_flight(plan, gcs.make_plan(rigid(plan.scenario))), folder / "map.png")
    yield write_film(plan, folder / "gap.gif", frame_s=1.5)


def survey(plan: Plan, folder: Path) -> Iterator[Path]:
    """What the vehicles see of the field: what `gcs show --coverage` draws."""
    path = folder / "coverage.png"
    save_coverage(plan, path)
    yield path


def rigid(scenario: Scenario) -> Scenario:
    """The same scenario with a formation that keeps its shape."""
    formation = scenario.formation.model_copy(update={"change": ()})
    return scenario.model_copy(update={"formation": formation})


PICTURES: dict[str, Callable[[Plan, Path], Iterator[Path]]] = {
    "simulation1": simulation1,
    "changes": changes,
    "circuit": whole,
    "gap": gap,
    "hundred": whole,
    "survey": survey,
}
TUTORIAL, GALLERY, PAGE = "tutorial", "gallery", "page"
NAMES = (*PICTURES, TUTORIAL, GALLERY, PAGE)


def main(
    missions: Annotated[list[str] | None, typer.Argument(help=f"Of {', '.join(NAMES)}; all when left out.")] = None,
) -> None:
    """Plan missions, or type the tutorial, and write docs/pictures/MISSION/*."""
    for name in missions or NAMES:
        if name not in NAMES:
            raise typer.BadParameter(f"no pictures of {name}; there are {', '.join(NAMES)}")
        folder = ROOT / "docs" / "pictures" / name
        folder.mkdir(parents=True, exist_ok=True)
        for path in written(name, folder):
            print(f"{path.relative_to(ROOT)}: {path.stat().st_size / 1000:.0f} kB")


def written(name: str, folder: Path) -> Iterator[Path]:
    """Paths of the pictures of one name, each when it is there."""
    if name == TUTORIAL:
        yield from write_pictures(ROOT / "docs" / "tutorial.md", folder)
    elif name == GALLERY:
        yield from write_gallery(ROOT, folder)
    elif name == PAGE:
        yield from write_page(ROOT, folder)
        yield from write_proposal(ROOT, folder)
        yield write_page_film(ROOT, folder / "flight.gif")
    else:
        yield from PICTURES[name](gcs.make_plan(gcs.load_scenario(ROOT / "missions" / name)), folder)


if __name__ == "__main__":
    typer.run(main)
