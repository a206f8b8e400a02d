"""A drawing as the scenario of a formation: its points in metres, its areas, its time, and the text."""
