"""Frames on the wire: codec and signing. Only the codec imports pymavlink."""
