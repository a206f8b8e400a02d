"""The missions, fences and rally points that one vehicle stores, and their transfers."""
