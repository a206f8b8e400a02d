"""The common time of a fleet, and GNSS times on board that are not to be used."""
