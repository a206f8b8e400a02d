"""What goes wrong in flight, what is ordered then, and how orders are carried out."""
