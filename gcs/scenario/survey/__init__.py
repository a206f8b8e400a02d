"""The survey of an area by vehicles in a line abreast: its passes, and the scenario that flies them."""
