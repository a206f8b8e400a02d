"""How autopilots fly waypoints: models that predict when a vehicle is where."""
