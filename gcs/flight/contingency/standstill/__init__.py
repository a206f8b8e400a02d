"""After a standstill of this program: what it tells, and how the vehicles get back to the plan."""
