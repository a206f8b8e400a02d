"""The ground at pads and landing points."""
