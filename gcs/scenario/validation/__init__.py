"""Rules that several tables must satisfy together, and the messages for scenarios that break them."""
