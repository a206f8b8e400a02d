"""Where bytes come from and go to: UDP, TCP, serial lines."""
