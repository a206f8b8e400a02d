"""Endpoints that send and receive bytes: UDP, TCP, serial lines."""
