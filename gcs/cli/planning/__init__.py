"""Commands about scenarios and plans."""
