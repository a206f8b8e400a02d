"""A fleet is loaded together, or not at all."""
