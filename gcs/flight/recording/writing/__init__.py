"""What a flight writes while it lasts. Nothing here raises: it reports a full disk, and the flight goes on."""
