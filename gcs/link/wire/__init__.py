"""Frames on the wire: codec, signing. The codec is the only module that imports pymavlink."""
