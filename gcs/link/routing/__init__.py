"""The address of each vehicle, the proof that a vehicle has moved, and the budget of strangers."""
