"""What the formation is ordered by itself when something happens in flight: the rows `[[on]]`."""

from typing import Annotated, Literal

from pydantic import Field

from gcs.scenario.schema.fields import FLIGHT_MAX_S, Findings, Number, Part, left_out

CONDITIONS = "battery_below_percent", "wind_above_mps", "silent_for_s", "at_s", "event"
CHANGES_SHAPE = {"scale": "factor", "shape": "shape"}  # orders, and the key that each needs
PLANNED = ("home", *CHANGES_SHAPE)  # orders that are answered by a new plan of the whole formation


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
    order: Literal["home", "hold", "land", "return", "scale", "shape"] = Field(
        description="home, scale and shape plan the rest of the flight anew for all; hold, land, return need no plan"
    )
    factor: Annotated[Number, Field(ge=0.001, le=10)] | None = left_out("scale: the new size over the present one")
    shape: str | None = left_out("shape: name of a shape of the formation")
    otherwise: Literal["hold", "land", "return"] | None = left_out(
        "home, scale, shape: the order where no plan is found; left out: the old plan is flown on"
    )

    def _disagreements(self) -> Findings:
        given = [key for key in CONDITIONS if getattr(self, key) is not None]
        if not given:
            yield (), "has no event", f"give one of {', '.join(CONDITIONS)}"
        for key in given[1:]:
            yield (key,), f"stands beside {given[0]}; a row has one event", "write a row for each"
        for order, key in CHANGES_SHAPE.items():
            is_given, is_needed = getattr(self, key) is not None, self.order == order
            if is_given and not is_needed:
                yield (key,), f'has no effect with order = "{self.order}"', f'remove it, or give order = "{order}"'
            if is_needed and not is_given:
                text = f'missing; order = "{order}" needs it ({type(self).model_fields[key].description})'
                yield (key,), text
        if self.otherwise is not None and self.order not in PLANNED:
            yield ("otherwise",), f'has no effect with order = "{self.order}", which needs no plan', "remove it"
        if self.silent_for_s is not None and self.order in PLANNED:
            text = "needs all vehicles: one that is not heard gets no new plan"
            yield ("order",), text, 'give "hold", "land" or "return"'
