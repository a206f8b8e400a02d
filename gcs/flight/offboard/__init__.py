"""The setpoint stream: references, deadlines, messages."""
