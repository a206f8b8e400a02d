"""Where scenarios come from: mission folders, templates, spreadsheets and survey areas.

It may import autopilots, scenario.environment, scenario.schema, scenario.validation and scenario.values.
"""
