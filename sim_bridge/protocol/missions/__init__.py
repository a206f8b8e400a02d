"""What one vehicle holds of missions, fences and rally points, and how it comes by them."""
