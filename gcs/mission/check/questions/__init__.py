"""Questions about items that are possible, but look like a slip of the person or program that wrote them."""
