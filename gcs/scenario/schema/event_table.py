"""What the formation is ordered by itself when something happens in flight: the rows `[[on]]`."""

from typing import Annotated, Literal

from pydantic import Field

from gcs.scenario.schema.fields import FLIGHT_MAX_S, Findings, Number, Part, Place, left_out

CONDITIONS = "battery_below_percent", "wind_above_mps", "silent_for_s", "at_s", "event"
CHANGES_SHAPE = "scale", "shape"
NEEDS = {"scale": "factor", "shape": "shape", "slower": "factor", "go": "position_m"}  # orders, and their keys
PLANNED = "home", "resume", *NEEDS  # orders that are answered by a new plan of the whole formation, or not at all
_PACES = 0.1, 0.99


class EventTable(Part):
    """One event and the order that answers it, once in a flight, between T0 and the landing."""

    battery_below_percent: Annotated[Number, Field(gt=0, lt=100)] | None = left_out(
        "when a vehicle reports less battery than this, percent of a full one"
    )
    wind_above_mps: Annotated[Number, Field(gt=0, le=100)] | None = left_out(
        "when a vehicle reports more wind than this, m/s"
    )
    silent_for_s: Annotated[Number, Field(ge=0.5, le=60)] | None = left_out(
        "when a vehicle was not heard for so long, s"
    )
    at_s: Annotated[Number, Field(ge=0, le=FLIGHT_MAX_S)] | None = left_out("at this time of the plan, s")
    event: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9_-]*$", max_length=40)] | None = left_out(
        "when the operator says that this happened: gcs tell event NAME"
    )
    order: Literal["home", "hold", "land", "return", "scale", "shape", "slower", "go", "resume"] = Field(
        description="all but land and return plan the rest of the flight anew for all; where no plan is found to hold "
        "as one, each vehicle brakes by itself"
    )
    factor: Annotated[Number, Field(ge=0.001, le=10)] | None = left_out(
        "scale: the new size over the present one; slower: the new speed over the present one, 0.1 to 0.99"
    )
    position_m: Place | None = left_out("go: north, east, height of the leader, m")
    shape: str | None = left_out("shape: name of a shape of the formation")
    otherwise: Literal["hold", "land", "return"] | None = left_out(
        "the order where no plan is found, of orders that need one; left out: the old plan is flown on"
    )

    def _disagreements(self) -> Findings:
        given = [key for key in CONDITIONS if getattr(self, key) is not None]
        if not given:
            yield (), "has no event", f"give one of {', '.join(CONDITIONS)}"
        for key in given[1:]:
            yield (key,), f"stands beside {given[0]}; a row has one event", "write a row for each"
        needed = NEEDS.get(self.order)
        for key in dict.fromkeys(NEEDS.values()):
            orders = " or ".join(f'"{order}"' for order, its in NEEDS.items() if its == key)
            if getattr(self, key) is not None and key != needed:
                yield (key,), f'has no effect with order = "{self.order}"', f"remove it, or give order = {orders}"
        if needed is not None and getattr(self, needed) is None:
            about = type(self).model_fields[needed].description
            yield (needed,), f'missing; order = "{self.order}" needs it ({about})'
        if self.order == "slower" and self.factor is not None and not _PACES[0] <= self.factor <= _PACES[1]:
            yield ("factor",), f"not from {_PACES[0]:g} to {_PACES[1]:g}, as slower needs it", "give for example 0.7"
        if self.otherwise is not None and self.order not in PLANNED:
            yield ("otherwise",), f'has no effect with order = "{self.order}", which needs no plan', "remove it"
        if self.silent_for_s is not None and self.order in PLANNED:
            text = "needs all vehicles: one that is not heard gets no new plan"
            yield ("order",), text, 'give "hold", "land" or "return"'
