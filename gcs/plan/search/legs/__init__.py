"""Flights of several legs: the times at their points, and the routes from point to point."""
