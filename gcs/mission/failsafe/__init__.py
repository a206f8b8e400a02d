"""What keeps vehicles safe when a plan ends early: fence, rally points, return (RTL) altitudes."""
