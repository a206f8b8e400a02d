"""After the flight: verdict, comparison of plan, estimate and truth, pictures."""
