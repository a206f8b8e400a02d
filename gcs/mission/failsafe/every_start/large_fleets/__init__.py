"""Returns of fleets above 12 vehicles, at one altitude, from every instant: groups of vehicles are bounded together."""
