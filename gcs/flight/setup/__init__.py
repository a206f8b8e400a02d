"""Before a flight: the missions to fly, pre-flight checks, loads, the simulator process."""
