"""Commands about vehicles and flights."""
