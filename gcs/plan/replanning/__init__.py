"""Plans that change in flight: programs built once, solved again from any state."""
