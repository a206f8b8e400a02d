"""Places that a scenario gives as latitude and longitude, converted once to metres from its origin."""
