"""The simulation loop: the vehicles of a scenario, their pace against real time, and the record of true states."""
